"""Whether time stamps are equally spaced, how fast, and where samples are missing between them."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.records.capture import missing

_TOLERANCE = 0.01
"""Of one step. Stamps printed with few digits pass; a missing or shifted sample does not."""
_PIECE = 1 << 18
_VOID = 2.0
"""Between the longest usual step and the shortest gap nothing lies over this factor: uneven sampling fills it."""
_USUAL = 0.8
"""Of all steps, so many at least are usual ones; with fewer, sampling is uneven and nothing is missing."""
_ROUND = 3
"""So many long steps, evenly spread, are a rate that its stamps are too coarse for."""


class Spacing(NamedTuple):
    """Samples per second (mean when not uniform), and the first row off the grid, None when all are on it."""

    rate_Hz: float
    first_off_grid: int | None


def first_not_increasing(t_s: npt.NDArray[np.float64]) -> int | None:
    """Row whose time is not later than the one before it, None when all are."""
    faults = np.flatnonzero(np.diff(t_s) <= 0)
    return int(faults[0]) + 1 if faults.size else None


def odd_step(t_s: npt.NDArray[np.float64], row: int) -> str:
    """The step to a row off the grid beside the usual one, in words."""
    return f"step of {t_s[row] - t_s[row - 1]:.6g} s where {float(np.median(np.diff(t_s))):.6g} s is usual"


def spacing(t_s: npt.NDArray[np.float64]) -> Spacing:
    """Fit an even grid to increasing time stamps (n ≥ 2).

    Among the rates that fit, one of six digits is preferred: stamps are rounded, crystals are specified.
    """
    rate = (t_s.size - 1) / float(t_s[-1] - t_s[0])
    for candidate in (float(f"{rate:.6g}"), rate):
        if _first_off(t_s, candidate) is None:
            return Spacing(float(candidate), None)
    # the end fits by construction; the usual step shows where the stamps leave the grid
    usual = 1 / float(np.median(np.diff(t_s)))
    return Spacing(float(rate), _first_off(t_s, usual) or 1)


def _first_off(t_s: npt.NDArray[np.float64], rate: float) -> int | None:
    """First stamp off a grid of so many steps a second that begins at the first stamp; None when all are on it."""
    for start in range(0, t_s.size, _PIECE):  # long records are gone through in parts
        elapsed = t_s[start : start + _PIECE] - t_s[0]
        off = np.abs(elapsed * rate - np.arange(start, start + elapsed.size)) > _TOLERANCE
        if off.any():
            return start + int(np.argmax(off))
    return None


class Numbered(NamedTuple):
    """Number of each row (n,) among all samples, those that are missing too; samples per second; whether all stamps
    are on that grid.
    """

    tick: npt.NDArray[np.int64]
    rate_Hz: float
    uniform: bool

    @property
    def lost(self) -> int:
        return int(self.tick[-1]) + 1 - self.tick.size

    @property
    def gaps(self) -> int:
        return int(np.count_nonzero(np.diff(self.tick) > 1))

    def missing(self) -> str:
        return missing(self.lost, self.gaps)

    @property
    def mostly_lost(self) -> bool:
        return self.lost > self.tick.size


def numbered(t_s: npt.NDArray[np.float64]) -> Numbered:
    """Number the rows of increasing time stamps (n ≥ 2), so that a gap takes as many numbers as samples are missing.

    A record whose stamps lie on an even grid is uniform, gaps or none.  Of uneven stamps a gap is a step beyond a void
    in the lengths of the steps.
    """
    rate, off = spacing(t_s)
    if off is None:
        return Numbered(np.arange(t_s.size), rate, True)
    on_grid = _on_grid(t_s)
    if on_grid is not None:
        return on_grid
    steps = np.diff(t_s)
    usual = float(np.median(steps))
    long = _beyond_void(steps)
    counts = np.where(long, np.maximum(np.round(steps / usual), 2.0), 1.0)
    tick = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return Numbered(tick, float(tick[-1] / (t_s[-1] - t_s[0])), False)


def _on_grid(t_s: npt.NDArray[np.float64]) -> Numbered | None:
    """Stamps of an even grid of which some are missing; None where they are none."""
    steps = np.diff(t_s)
    usual = float(np.median(steps))
    counts = np.maximum(np.round(steps / usual), 1.0)
    if np.mean(counts == 1.0) < _USUAL or _is_rounded(counts):
        return None
    tick = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    rate = tick[-1] / float(t_s[-1] - t_s[0])
    for candidate in (float(f"{rate:.6g}"), float(rate)):
        if np.all(np.abs((t_s - t_s[0]) * candidate - tick) <= _TOLERANCE):
            return Numbered(tick, candidate, True)
    return None


def _is_rounded(counts: npt.NDArray[np.float64]) -> bool:
    """Whether long steps are those of stamps that are too coarse for their rate: of one more than usual, and evenly
    spread.  Samples that are lost are neither.
    """
    long = np.flatnonzero(counts > 1.0)
    return len(long) >= _ROUND and bool(np.all(counts[long] == 2.0)) and int(np.ptp(np.diff(long))) <= 1


def _beyond_void(steps: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Which steps are gaps: those beyond the first void above the usual ones."""
    ordered = np.sort(steps)
    first = int(np.ceil(_USUAL * ordered.size))
    voids = np.flatnonzero(ordered[1:] >= _VOID * ordered[:-1]) + 1
    voids = voids[voids >= max(first, 1)]
    return steps >= (ordered[voids[0]] if voids.size else np.inf)
