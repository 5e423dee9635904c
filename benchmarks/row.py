"""One figure: a row of runs/bench.json."""

from collections.abc import Callable
from typing import NamedTuple

Say = Callable[[str], None]


class Row(NamedTuple):
    """`value` in `unit`; where another was measured in the same run, `peer` names it and `ratio` is value over it."""

    name: str
    value: float
    unit: str
    peer: str | None = None
    ratio: float | None = None
