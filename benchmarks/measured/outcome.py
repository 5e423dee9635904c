"""What one measured record gives: rows of the table, words, figures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from estimator.scaling import Array
from estimator.trace.diagnosis import Verdict

Say = Callable[[str], None]

_LEFT = 0.1  # of the power above the noise, what may be left where a record counts as explained
_NEAR = 3.0  # ratio to the noise up to which a model that nothing was added to counts as adequate


class MeasuredRow(NamedTuple):
    """One line of runs/measured.json: an error on data the choice never saw, before and after."""

    record: str
    split: str
    metric: str
    unit: str
    before: float
    after: float
    verdict: str
    effects: list[str]


@dataclass(frozen=True)
class Panel:
    """A figure of two curves over one axis: before and after, or measured and model."""

    name: str
    title: str
    x: Array
    x_label: str
    curves: Sequence[tuple[str, Array]]
    y_label: str
    logarithmic: bool = False


@dataclass(frozen=True)
class Outcome:
    """Rows, paragraphs in Markdown, figures."""

    title: str
    rows: list[MeasuredRow]
    paragraphs: list[str]
    panels: list[Panel] = field(default_factory=list)


def verdict_of(before: float, after: float, noise: float, effects: Sequence[str]) -> Verdict:
    """The verdict by the error on the held-out part, all three in one unit."""
    if not effects:
        return Verdict.ADEQUATE if before <= _NEAR * noise else Verdict.UNEXPLAINED
    was, left = (max(error**2 - noise**2, 0.0) for error in (before, after))
    return Verdict.EXPLAINED if after <= _NEAR * noise or left <= _LEFT * was else Verdict.UNEXPLAINED


def rms(series: Array) -> float:
    """Root mean square of what is a number in it."""
    return float(np.sqrt(np.nanmean(np.asarray(series) ** 2)))
