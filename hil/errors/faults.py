"""A fault of the program: one line for the user, the traceback in a file of its own."""

import os
import tempfile
import traceback

_OF_HIL = "a fault of hil"


def fault_line(error: BaseException, *, said: bool = True) -> str:
    """What is said of an error that nobody but the authors can mend; `said`: with its own words, which a client of a
    service need not know.
    """
    words = f"{type(error).__name__}: {error if said else ''}"
    told = " ".join(words.split()).rstrip(": ")
    return f"{_OF_HIL}: {told}"


def is_fault(said: str | None) -> bool:
    """Whether a line of a result, a row or a job speaks of one."""
    return said is not None and _OF_HIL in said


def kept_fault(error: BaseException) -> str:
    """The same with where the traceback is; where it cannot be written, it is printed."""
    told = "".join(traceback.format_exception(error))
    try:
        number, place = tempfile.mkstemp(prefix="hil-fault-", suffix=".txt")
        with os.fdopen(number, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(told)
    except OSError:
        traceback.print_exception(error)
        return f"{fault_line(error)}; please report it with the lines above"
    return f"{fault_line(error)}; please report it with {place}"
