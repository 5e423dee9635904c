"""Whether time stamps are equally spaced, and how fast."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

_TOLERANCE = 0.01
"""Of one step. Stamps printed with few digits pass; a missing or shifted sample does not."""


class Spacing(NamedTuple):
    """Samples per second (mean when not uniform), and the first row off the grid, None when all are on it."""

    rate_Hz: float
    first_off_grid: int | None


def first_not_increasing(t_s: npt.NDArray[np.float64]) -> int | None:
    """Row whose time is not later than the one before it, None when all are."""
    faults = np.flatnonzero(np.diff(t_s) <= 0)
    return int(faults[0]) + 1 if faults.size else None


def spacing(t_s: npt.NDArray[np.float64]) -> Spacing:
    """Fit an even grid to increasing time stamps (n ≥ 2).

    Among the rates that fit, one of six digits is preferred: stamps are rounded, crystals are specified.
    """
    steps = np.arange(t_s.size)
    elapsed = t_s - t_s[0]
    rate = (t_s.size - 1) / elapsed[-1]
    for candidate in (float(f"{rate:.6g}"), rate):
        off = np.abs(elapsed * candidate - steps) > _TOLERANCE
        if not off.any():
            return Spacing(float(candidate), None)
    # the end fits by construction; the usual step shows where the stamps leave the grid
    usual = 1 / float(np.median(np.diff(t_s)))
    off = np.abs(elapsed * usual - steps) > _TOLERANCE
    return Spacing(float(rate), int(np.argmax(off)) or 1)
