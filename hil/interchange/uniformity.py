"""Whether time stamps are equally spaced, and how fast."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

_TOLERANCE = 0.01
"""Of one step. Stamps printed with few digits pass; a missing or shifted sample does not."""
_PIECE = 1 << 18


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
