"""What a long piece of work tells whoever watches; the command line draws it, tests count it."""

from collections.abc import Callable
from typing import NamedTuple


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
