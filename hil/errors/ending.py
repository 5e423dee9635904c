"""How whatever went wrong ends: exit code, line and status of an answer, decided here for every program."""

from typing import NamedTuple

from hil.errors.exit_codes import ExitCode
from hil.errors.faults import fault_line, kept_fault
from hil.errors.input import InputError, told_to_user

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
