"""A refusal as a program reads it: what is wrong, and what to do about it, one line each."""

from typing import NamedTuple

from hil.errors.input import printable

_LONGEST = 400  # characters of a line: what was given may be quoted in it


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
    line = printable(" ".join(text[: 4 * _LONGEST].split()))
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"
