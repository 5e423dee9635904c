"""Stamps that are an even grid, rounded: which rate it has, and which sample each row is."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
_FEWEST = 10
"""Rows from which a rate is told: rounding fits nearly any three."""
_HALVINGS = 60
_REPEATS = 3
"""Stamps twice in a row from which a rate above their resolution is told: one or two are rows written twice."""
_JITTER = 0.1
"""Of a step: what stamps of a stated rate may be off beside their rounding."""

_USUAL = 0.8
"""Of all steps, so many at least are of one sample where stamps are off by all of their rounding."""


class Grid(NamedTuple):
    """Samples per second, and the number of each row (n,)."""

    rate_Hz: float
    tick: npt.NDArray[np.int64]


def rounded_grid(elapsed: Floats, digit: float) -> Grid | None:
    """The grid from which all stamps differ by the rounding to `digit` seconds alone; None where there is none.

    elapsed (n,): seconds, not falling.  Of the rates that fit, one of few digits is preferred.
    """
    if elapsed.size < _FEWEST or digit <= 0.0:
        return None
    steps = np.diff(elapsed)
    if np.any(steps < 0.0):
        return None
    usual = float(np.median(steps))
    near = steps[np.abs(steps - usual) <= 1.5 * digit]
    step = float(np.mean(near))
    if step <= 0.0:
        return None
    repeats = int(np.count_nonzero(steps == 0.0))
    if 0 < repeats < _REPEATS:
        return None
    found = _fitted(elapsed, np.arange(elapsed.size, dtype=float), digit)
    if repeats:  # only of more than one sample to a stamp
        return found if found is not None and found.rate_Hz * digit > 1.0 + 1e-9 else None
    if found is None:
        counts = np.maximum(np.round(steps / step), 1.0)
        found = _fitted(elapsed, np.concatenate([[0.0], np.cumsum(counts)]), digit)
    return found


def _fitted(elapsed: Floats, tick: Floats, digit: float) -> Grid | None:
    """The rate at which rows of these numbers have these stamps, rounded; None where none has."""
    # the range of the residual is convex in the step
    low, high = (elapsed[-1] + sign * 2.0 * digit for sign in (-1.0, 1.0))
    low, high = low / tick[-1], high / tick[-1]
    for _ in range(_HALVINGS):
        third = (high - low) / 3.0
        if np.ptp(elapsed - (low + third) * tick) <= np.ptp(elapsed - (high - third) * tick):
            high -= third
        else:
            low += third
    best = 0.5 * (low + high)
    allowed = digit * (1.0 + 1e-6)
    for digits in range(1, 8):
        rate = float(f"{1.0 / best:.{digits}g}")
        if np.ptp(elapsed - tick / rate) < allowed:
            return Grid(rate, tick.astype(np.int64))
    return Grid(1.0 / best, tick.astype(np.int64)) if np.ptp(elapsed - best * tick) < allowed else None


def stated_grid(elapsed: Floats, rate_Hz: float, digit: float) -> Grid | int:
    """The grid of a stated rate, from which stamps differ by their rounding to `digit` seconds and a tenth of a step;
    the first row that differs by more, or stands where the one before does, where one does.

    The stamps number the rows where they tell samples apart; coarser ones follow one another without a gap.
    """
    samples = elapsed * rate_Hz
    rounding = digit * rate_Hz
    by_stamp = np.round(samples - _phase(samples))
    by_stamp -= by_stamp[0]
    repeated = np.concatenate([[False], np.diff(by_stamp) < 1.0])
    apart = rounding <= 1.0 + 1e-9
    if apart and not repeated.any():
        spread, usual = float(np.ptp(samples - by_stamp)), np.mean(np.diff(by_stamp) == 1.0) >= _USUAL
        if spread < rounding - 1e-9 or (usual and spread <= min(rounding + _JITTER, 1.0 - 1e-9)):
            return Grid(rate_Hz, by_stamp.astype(np.int64))
    off = samples - np.arange(elapsed.size)
    again = np.concatenate([[False], np.diff(elapsed) <= 0.0]) & apart
    if np.ptp(off) <= rounding + _JITTER and not again.any():
        return Grid(rate_Hz, np.arange(elapsed.size, dtype=np.int64))
    if again.any():
        return int(np.argmax(again))
    off = samples - by_stamp
    allowed = min(rounding, 1.0 - 2.0 * _JITTER) + _JITTER
    wrong = repeated | (np.maximum.accumulate(off) - np.minimum.accumulate(off) > allowed)
    return int(np.argmax(wrong))


def _phase(samples: Floats) -> float:
    """Where between whole numbers the samples lie: opposite to the widest stretch of a step in which none does."""
    parts = np.sort(samples % 1.0)
    widths = np.diff(np.concatenate([parts, parts[:1] + 1.0]))
    widest = int(np.argmax(widths))
    return float(parts[widest] + 0.5 * widths[widest] + 0.5) % 1.0
