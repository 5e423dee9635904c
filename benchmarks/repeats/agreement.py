"""The share of 95 % intervals that agree: with the truth, or, of repeats without one, with the other repeats."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import beta

_T95 = 1.959963984540054


@dataclass(frozen=True)
class Repeated:
    """A coefficient from each of several repeats: values and half widths of their 95 % intervals, and what is true,
    where that is known; missed: repeats that did not name it.
    """

    record: str
    symbol: str
    values: Sequence[float]
    halves: Sequence[float]
    truth: float | None = None
    missed: int = 0
    off: list[float] = field(init=False)
    """Of each, by how much it is off the truth, or the mean of the others, in half widths of what that may be."""

    def __post_init__(self) -> None:
        values, halves = np.array(self.values), np.array(self.halves)
        if self.truth is not None:
            off = (values - self.truth) / halves
        else:
            off = np.array([_beside_the_others(values, halves, place) for place in range(len(values))])
        object.__setattr__(self, "off", off.tolist())

    @property
    def agree(self) -> int:
        """How many of them do."""
        return sum(abs(one) <= 1.0 for one in self.off)

    @property
    def spread(self) -> float:
        """Scatter over what the intervals say: 1 where they are right."""
        return float(_T95 * np.sqrt(np.mean(np.square(self.off)))) if self.off else float("nan")


def _beside_the_others(values: np.ndarray, halves: np.ndarray, place: int) -> float:
    """Off the weighted mean of the others, which has an interval itself."""
    rest = np.arange(len(values)) != place
    weight = 1.0 / halves[rest] ** 2
    mean = float(np.sum(weight * values[rest]) / np.sum(weight))
    return float((values[place] - mean) / np.hypot(halves[place], 1.0 / np.sqrt(np.sum(weight))))


def share(repeated: Sequence[Repeated]) -> tuple[int, int, float, float]:
    """How many agree, of how many, and the 95 % interval of the share (Clopper and Pearson)."""
    number, agree = sum(len(one.off) for one in repeated), sum(one.agree for one in repeated)
    low = float(beta.ppf(0.025, agree, number - agree + 1)) if agree else 0.0
    high = float(beta.ppf(0.975, agree + 1, number - agree)) if agree < number else 1.0
    return agree, number, low, high
