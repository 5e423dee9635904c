"""The one error a user of the bench meets when something given to it cannot be used."""

import errno
import os
import unicodedata
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint  # which every command would load

_LONGEST, _END = 900, 300
_TOLD_APART = {ord("\n"): "\\n", ord("\t"): "\\t", ord("\r"): "\\r"}


def printable(text: str) -> str:
    """`text` with everything that a terminal would obey or hide written out: control characters, escape sequences,
    marks that change the direction of writing, lone surrogates. Letters and spaces of all scripts stay."""
    return "".join(mark if _harmless(mark) else _TOLD_APART.get(ord(mark)) or _escape(mark) for mark in text)


def printable_json(text: str) -> str:
    """JSON text that says the same, with what `printable` writes out written as JSON does. Such marks stand in strings
    only, but for the line feeds between them, which stay."""
    return "".join(mark if mark == "\n" or _harmless(mark) else _json_escape(mark) for mark in text)


def _harmless(mark: str) -> bool:
    return mark.isprintable() or unicodedata.category(mark) == "Zs"


def _json_escape(mark: str) -> str:
    units = mark.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[at : at + 4]}" for at in range(0, len(units), 4))


def _escape(mark: str) -> str:
    code = ord(mark)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


class InputError(ValueError):
    """A file, key or value given by the user is unusable.

    The message is one line that names the place and the remedy, e.g.
    ``ride.csv:17: column vy_V: 'abc' is not a number; correct or remove the row``.
    The command line prints it and exits with 2.  Where the message speaks of a function's arguments, `typed` is the
    same with the options of the command line, which prints that.  `status` is that of an answer over HTTP.
    """

    status = 400

    def __init__(self, message: str, *, typed: str | None = None) -> None:
        line = printable(" ".join(message.split()))
        super().__init__(line if len(line) <= _LONGEST else f"{line[: _LONGEST - _END]} … {line[-_END:]}")
        self.typed = str(self) if typed is None else typed


_FULL = (errno.ENOSPC, errno.EDQUOT)
_NOT_OURS = (*_FULL, errno.EROFS, errno.EIO, errno.EFBIG, errno.EMFILE, errno.ENFILE)
_PACKAGES = ("hil", "estimator", "device_emulator")


def machine_fault(error: BaseException) -> OSError | None:
    """The error of this machine behind another one, as a full disk is behind "cannot be written"; None without."""
    found: BaseException | None = error
    while found is not None and not (isinstance(found, OSError) and found.errno in _NOT_OURS):
        found = found.__cause__ or found.__context__
    return found


def told_to_user(error: BaseException) -> str | None:
    """What a user has to know about ``error``, or None when the fault is ours (`hil.errors.ending`).

    Known by the package of its class: an emulator's errors come through an entry point, and nothing here may import
    them.
    """
    if isinstance(error, InputError):
        return error.typed
    if type(error).__module__.partition(".")[0] in _PACKAGES:
        return str(error)
    if isinstance(error, OSError) and error.filename is not None:
        remedy = "make room, or give another place" if error.errno in _FULL else "give a place that can be used"
        return f"{error.filename}: {(error.strerror or 'cannot be used').lower()}; {remedy}"
    if isinstance(error, OSError) and error.errno in _NOT_OURS:  # of a write, which does not know the file's name
        return f"a file cannot be written: {os.strerror(error.errno).lower()}; make room, or give another place"
    if isinstance(error, MemoryError):
        return "out of memory: the given values need more than this machine has"
    return None


def require(argument: str, given: object, kind: Any, wanted: str) -> None:
    """InputError that names the argument where what is given is not of that kind, as isinstance has it; `wanted` is
    what that is called.
    """
    if not isinstance(given, kind):
        raise InputError(f"{argument}: expected {wanted}, not {'None' if given is None else type(given).__name__}")


def path_of(argument: str, given: Any, wanted: str = "a path") -> Path:
    """What is given, as a path.  Raises InputError where it is none."""
    require(argument, given, str | os.PathLike, wanted)
    return Path(given)


def names_of(argument: str, given: str | Sequence[str]) -> tuple[str, ...]:
    """One name or several.  Raises InputError for anything else."""
    if isinstance(given, str):
        return (given,)
    require(argument, given, Sequence, "a name or a list of names")
    for one in given:
        require(argument, one, str, "names")
    return tuple(given)


def loaded(entry: "EntryPoint", asked: str) -> Any:
    """The object of an entry point; `asked`: what needs it, as an error begins.  Raises InputError."""
    try:
        return entry.load()
    except Exception as error:  # whatever another package does wrong
        raise InputError(
            f"{asked}: {entry.value} cannot be loaded: {error}; mend or remove the package that brings it"
        ) from error


_LONGEST_LINE = 400  # characters of a line: what was given may be quoted in it


class Refusal(NamedTuple):
    """Two lines for a program."""

    error: str
    remedy: str


def refusal_of(line: str, remedy: str = "", otherwise: str = "") -> Refusal:
    """What is wrong and what to do about it: where no remedy is given it is the end of the line, behind its last
    semicolon, as every error of the bench has it, else `otherwise`.
    """
    if not remedy:
        said, mark, last = line.rpartition("; ")
        line, remedy = (said, last) if mark and last.strip() else (line, otherwise)
    return Refusal(_line(line) or "refused", _line(remedy))


def _line(text: str) -> str:
    line = printable(" ".join(text[: 4 * _LONGEST_LINE].split()))
    return line if len(line) <= _LONGEST_LINE else f"{line[: _LONGEST_LINE - 1]}…"
