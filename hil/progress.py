"""What a long piece of work tells whoever watches; the command line draws it, tests count it."""

from collections.abc import Callable
from typing import NamedTuple


class Progress(NamedTuple):
    """One report: ``done`` of ``total`` steps of ``stage``; ``note`` is a few words on how it goes."""

    stage: str
    done: int
    total: int
    note: str = ""


Watcher = Callable[[Progress], None]
