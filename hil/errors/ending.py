"""How whatever went wrong ends: exit code, line and status of an answer, decided here for every program."""

import os
import tempfile
import traceback
from enum import IntEnum
from typing import NamedTuple

from hil.errors.input import InputError, told_to_user


class ExitCode(IntEnum):
    """One meaning each, whatever the verb."""

    GOOD = 0
    AGAINST = 1
    """the verdict is not good, or a residual stays unexplained"""
    BAD_INPUT = 2
    """one line says what and where"""
    FAULT = 3
    """of the program itself: nothing is said of the board, the record or the model"""
    INTERRUPTED = 130
    """Ctrl-C or SIGTERM"""


REFUSED, NO_ROOM, OUR_FAULT = 400, 507, 500
"""Statuses of HTTP; a refusal that knows a better one than 400 carries it."""


class Ending(NamedTuple):
    """The exit code of a program that ends by an error, the one line that is said of it, the status of an answer."""

    code: ExitCode
    line: str
    status: int


def ending_of(error: BaseException, *, keep: bool = False) -> Ending:
    """How a program ends by `error`; keep: the traceback of a fault of ours is kept in a file, and the line says where.

    The line of an `InputError` speaks of options, as the command line has them.
    """
    if isinstance(error, KeyboardInterrupt):
        return Ending(ExitCode.INTERRUPTED, str(error) or "interrupted", REFUSED)
    if (line := told_to_user(error)) is None:
        return Ending(ExitCode.FAULT, kept_fault(error) if keep else fault_line(error), OUR_FAULT)
    of_machine = isinstance(error, OSError | MemoryError) and not type(error).__module__.startswith("hil.")
    status = error.status if isinstance(error, InputError) else NO_ROOM if of_machine else REFUSED
    return Ending(ExitCode.BAD_INPUT, line, status)


def line_of(error: BaseException) -> str:
    """What is said of `error`, where a program goes on."""
    return ending_of(error).line


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
