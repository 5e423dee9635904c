"""Where a search for a mode that rings freely begins: a line that free runs leave, and how fast it dies away."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS
from estimator.trace.start_values import resonance

_SET = THRESHOLDS.candidates


def rings(residuals: Sequence[Array], sample_rate: float, itself: float) -> list[tuple[float, float]]:
    """Frequency rad/s and rate of decay 1/s (of the power) of the strongest lines that residuals (n, axes) share, none
    of them at a multiple of the resonance `itself`, rad/s.
    """
    length = _SET.ring_bins * max(len(one) for one in residuals)
    channels = [np.nan_to_num(column) for one in residuals for column in one.T]
    spectra = [np.fft.rfft(column - np.mean(column), length) for column in channels]
    # Lines are told by a window, or the strongest would have others beside it; how fast one dies away, without.
    told = [np.fft.rfft((column - np.mean(column)) * np.hanning(len(column)), length) for column in channels]
    power = np.sum([np.abs(one) ** 2 for one in told], axis=0)
    omega: Array = 2.0 * np.pi * np.fft.rfftfreq(length, 1.0 / sample_rate).astype(np.float64)
    order = omega / itself
    own = (np.abs(order - np.round(order)) < _SET.ring_apart) | (order < _SET.ring_apart)
    tops = peaks(power)
    tops = tops[~own[tops]]
    found: list[tuple[float, float]] = []
    for top in sorted(tops.tolist(), key=lambda place: -power[place]):
        if len(found) == _SET.rings:
            break
        if any(abs(omega[top] - other) < _SET.ring_apart * itself for other, _ in found):
            continue  # a side of a line that is there already
        near = slice(max(top - _SET.ring_bins, 1), top + _SET.ring_bins + 1)
        seen = resonance(omega[near], [one[near] for one in spectra])
        longest = max(len(one) for one in residuals) / sample_rate
        found.append((float(omega[top]), 2.0 / longest) if seen is None else (seen[0], 2.0 * seen[1] * seen[0]))
    return found


def peaks(power: Array) -> NDArray[np.int64]:
    """Where a spectrum is above both its neighbours; `scipy.signal`, which has this too, loads for half a second."""
    return 1 + np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] > power[2:]))
