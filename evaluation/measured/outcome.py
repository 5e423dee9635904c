"""What one measured record gives: rows of the table, words."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.diagnosis import Verdict
from estimator.scaling import Array
from estimator.trace.likelihood import AT_FLOOR
from estimator.trace.verdict import MOST

Say = Callable[[str], None]


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
class Outcome:
    """Rows, paragraphs in Markdown; seconds: what it took on the wall, import included."""

    title: str
    rows: list[MeasuredRow]
    paragraphs: list[str]
    seconds: float = 0.0


def rms(series: Array) -> float:
    """Root mean square of what is a number in it."""
    return float(np.sqrt(np.nanmean(np.asarray(series) ** 2)))


def verdict_of(before: float, after: float, noise: float, effects: Collection[str]) -> Verdict:
    """The verdict by the error on the held-out part alone, all three in one unit."""
    if not effects:
        return Verdict.ADEQUATE if before <= AT_FLOOR * noise else Verdict.UNEXPLAINED
    if after < before and after <= AT_FLOOR * noise:
        return Verdict.EXPLAINED
    gone = (before**2 - max(after, noise) ** 2) / (before**2 - noise**2) if before > noise else 0.0
    return Verdict.PARTLY if gone > MOST else Verdict.UNEXPLAINED
