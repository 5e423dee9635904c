"""What the runs of a campaign came to together: errors over their bound, and whether the observers knew how wrong they
were."""

import shlex
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.numbers import SD_95
from hil.scoring.nees import band
from hil.sweeping.columns import STATES

if TYPE_CHECKING:
    import pyarrow


Floats = npt.NDArray[np.float64]

_DRAWS = 2000
_OVER_BOUND = {
    "rate, at the end": ("error_rate_rad_s", "bound_rate_end_rad_s"),
    "rate, scored window": ("rate_error_rms_rad_s", "bound_rate_rms_rad_s"),
    "pattern angle, at the end": ("pattern_error_end_rad", "bound_pattern_end_rad"),
    "pattern angle, scored window": ("pattern_error_rms_rad", "bound_pattern_rms_rad"),
}


class Ratio(NamedTuple):
    """Root mean square over the runs of error over bound, with its 95 % interval by resampling the runs."""

    what: str
    runs: int
    ratio: float
    interval: tuple[float, float]


class Knows(NamedTuple):
    """NEES per entry at the end of each run, mean over the runs, beside the 95 % band of χ²; and the shares of runs
    whose 95 % interval holds the truth at the end, by state, beside the band of that share."""

    runs: int
    entries: int
    nees: float
    nees_band: tuple[float, float]
    held: dict[str, float]
    held_band: tuple[float, float]


def over_bound(table: "pyarrow.Table") -> list[Ratio]:
    """Of whatever has a bound."""
    found = []
    for what, (error, bound) in _OVER_BOUND.items():
        e, b = column(table, error), column(table, bound)
        known = np.isfinite(e) & (b > 0.0)
        if np.count_nonzero(known) > 1:
            squares = (e[known] / b[known]) ** 2
            found.append(Ratio(what, len(squares), float(np.sqrt(squares.mean())), _resampled(squares)))
    return found


def knows(table: "pyarrow.Table") -> Knows | None:
    """None where no run has an NEES."""
    nees, entries = column(table, "nees_end"), column(table, "nees_entries")
    known = np.isfinite(nees) & (entries > 0)
    if not known.any():
        return None
    degrees = float(entries[known].sum())
    held, runs = {}, int(known.sum())
    for name in STATES:
        error, sd = column(table, f"error_{name}")[known], column(table, f"sd_{name}")[known]
        there = np.isfinite(error) & (sd > 0.0)
        if there.any():
            held[name] = float(np.mean(np.abs(error[there]) <= SD_95 * sd[there]))
    spread = SD_95 * float(np.sqrt(0.95 * 0.05 / runs))
    return Knows(
        runs=runs,
        entries=int(entries[known].max()),
        nees=float(np.sum(nees[known] * entries[known]) / degrees),
        nees_band=band(degrees),
        held=held,
        held_band=(0.95 - spread, min(0.95 + spread, 1.0)),
    )


def column(table: "pyarrow.Table", name: str) -> Floats:
    """A column (runs,) of numbers; what is missing is not a number."""
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=float)


def _resampled(squares: Floats) -> tuple[float, float]:
    generator = np.random.default_rng(0)
    means = [squares[generator.integers(0, len(squares), len(squares))].mean() for _ in range(_DRAWS)]
    low, high = np.sqrt(np.percentile(means, (2.5, 97.5)))
    return float(low), float(high)


class Worst(NamedTuple):
    """A run: its number, outcome, the figure, its row, and how to have it again byte for byte."""

    run: int
    outcome: str
    value: float | None
    row: dict[str, Any]
    command: str


def worst_of(table: "pyarrow.Table", figure: str, most: int, campaign: str) -> list[Worst]:
    """Runs that did not run to their end first, then by the figure's magnitude."""
    if not len(table):
        return []
    size = np.abs(column(table, figure))
    outcome = np.array(table["outcome"].to_pylist())
    rank = np.where(outcome == "ran", np.where(np.isfinite(size), size, np.inf), np.inf)
    failed = outcome != "ran"
    order = np.lexsort((np.arange(len(rank)), -rank, ~failed))[:most]
    return [_worst(table.slice(int(place), 1).to_pylist()[0], figure, campaign) for place in order]


def _worst(row: dict[str, Any], figure: str, campaign: str) -> Worst:
    return Worst(row["run"], row["outcome"], row[figure], row, replay_command(campaign, row["run"]))


def replay_command(campaign: str, run: int) -> str:
    return f"hil sweep {shlex.quote(campaign)} --only {run}"
