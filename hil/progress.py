"""What a long piece of work tells its watcher: the command line draws it, tests count it."""

import sys
from collections.abc import Callable
from typing import NamedTuple

from hil.errors import printable


class Progress(NamedTuple):
    """One report: ``done`` of ``total`` steps of ``stage``; ``note`` is a few words on how it goes, ``alarm`` a line
    that has to be seen at once, whatever else is shown; ``left_s`` an estimate of the seconds until all is done."""

    stage: str
    done: int
    total: int
    note: str = ""
    alarm: str = ""
    left_s: float | None = None


Watcher = Callable[[Progress], None]


def untold(_: Progress) -> None:
    """Instead of a watcher, where nobody watches."""


def alarms_only(progress: Progress) -> None:
    """What nobody may miss goes to standard error, the rest nowhere."""
    if progress.alarm:
        alarm(progress.alarm)


def alarm(words: str) -> None:
    """Say on standard error what may move or is still driven."""
    print(printable(f"hil: UNSAFE: {words}"), file=sys.stderr, flush=True)
