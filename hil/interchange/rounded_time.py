"""Stamps that are an even grid, rounded: which rate it has, and which sample each row is."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
_FEWEST = 10
"""Rows from which a rate is told: rounding fits nearly any three."""
_HALVINGS = 60
_JITTER = 0.1
"""Of a step: what stamps of a stated rate may be off beside their rounding."""


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
    counts = np.ones(steps.size) if np.any(steps == 0.0) else np.maximum(np.round(steps / step), 1.0)
    tick = np.concatenate([[0.0], np.cumsum(counts)])
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
    the first row that differs by more, where one does.
    """
    samples = elapsed * rate_Hz
    allowed = digit * rate_Hz + _JITTER
    tick = np.arange(elapsed.size, dtype=float)
    if np.ptp(samples - tick) > allowed:
        tick = np.round(samples)
        tick = np.round(samples - np.median(samples - tick))
        tick -= tick[0]
        allowed = min(allowed, 1.0 - _JITTER)
    off = samples - tick
    falling = np.concatenate([[False], np.diff(tick) < 1.0])
    if np.ptp(off) <= allowed and not falling.any():
        return Grid(rate_Hz, tick.astype(np.int64))
    wrong = falling | (np.maximum.accumulate(off) - np.minimum.accumulate(off) > allowed)
    return int(np.argmax(wrong))
