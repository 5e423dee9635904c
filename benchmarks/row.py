"""One figure: a row of runs/bench.json."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

import numpy as np

Say = Callable[[str], None]


class Row(NamedTuple):
    """`value` in `unit`; where another was measured in the same run, `peer` names it and `ratio` is value over it;
    `low` and `high` are the quartiles of the ratio over the rounds, where there were some.
    """

    name: str
    value: float
    unit: str
    peer: str | None = None
    ratio: float | None = None
    low: float | None = None
    high: float | None = None

    @classmethod
    def over(cls, name: str, value: float, unit: str, peer: str, ratios: Sequence[float] | np.ndarray) -> Self:
        """With the ratio of each round."""
        low, middle, high = (float(each) for each in np.percentile(np.asarray(ratios, dtype=float), (25, 50, 75)))
        return cls(name, value, unit, peer, middle, low, high)
