"""The noise that would be left by a complete model, from the record itself where that can be had.

Three sources, best first: repeats of a periodic drive, the innovation's spectrum high above the resonance and away from
its multiples, and what the observer predicts from the declared noise.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.chance import chi2_isf
from estimator.residual.spectrum import FLOOR_BINS, ORDERS, Periodogram, floor_deviation, folded
from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS


@dataclass(frozen=True)
class Floor:
    """rms (axes,) in volts per sample, its relative standard deviation, and where it is from, in words."""

    rms: Array
    uncertainty: float
    source: str


def noise_floor(
    spectrum: Periodogram,
    predicted: Array,
    sample_rate: float,
    resonance: float,
    repeats: Array | None = None,
    *,
    filtered: bool = False,
) -> Floor:
    """The floor of the record behind `spectrum`.

    predicted (n, axes): standard deviation of the innovation that the observer expects; repeats (axes,): noise from
    `repeated_noise`, where there was any; filtered: whether the record passed a filter: beside its band the spectrum
    tells of the filter, not of the noise within.
    """
    if repeats is not None:
        return Floor(repeats, 0.0, "repeats of the drive")
    if filtered:
        return Floor(np.nanmedian(predicted, axis=0), 0.0, "the declared noise, behind the record's filter")
    quiet = quiet_bins(spectrum.frequency, sample_rate, resonance)
    count = int(np.sum(quiet))
    if count < FLOOR_BINS:
        return Floor(np.nanmedian(predicted, axis=0), 0.0, "the declared noise")
    median = np.median(spectrum.density[quiet], axis=0) / math.log(2.0)
    uncertainty = floor_deviation(count) / 2.0  # an amplitude's is half of a power's
    return Floor(np.sqrt(median * sample_rate / 2.0), uncertainty, "the spectrum away from the resonance")


def quiet_bins(frequency: Array, sample_rate: float, resonance: float) -> NDArray[np.bool_]:
    """Which frequencies (m,) tell the floor: the upper half of the spectrum, without multiples of the resonance.

    With so few samples a cycle that nothing is left, the whole spectrum without them.
    """
    away: NDArray[np.bool_] = np.ones(len(frequency), dtype=bool)
    for order in range(ORDERS + 1):
        away &= np.abs(frequency - folded(order * resonance, sample_rate)) > THRESHOLDS.spectrum.sideband * resonance
    upper: NDArray[np.bool_] = away & (frequency > sample_rate / THRESHOLDS.floor.upper)
    return upper if np.sum(upper) >= FLOOR_BINS else away


def repeated_noise(sense: Array, drive: Array) -> Array | None:
    """Noise (axes,) in volts from periods of the drive that repeat exactly, None where they do not.

    sense (n, axes) V, drive (n, axes).  Two periods of a settled response differ by noise only; the median of the pairs
    of periods is taken, since the first ones may still be settling, over that of χ².
    """
    period = _period(drive)
    if period is None:
        return None
    difference = sense[period:] - sense[:-period]
    pairs = len(difference) // period
    if pairs < 1:
        return None
    size = np.array([np.nanmean(difference[i * period : (i + 1) * period] ** 2, axis=0) for i in range(pairs)])
    usual = np.quantile(size, 0.5, axis=0, method="lower")
    return np.asarray(np.sqrt(usual * period / chi2_isf(0.5, float(period)) / 2.0))


def _period(drive: Array) -> int | None:
    """Samples after which the drive comes back exactly, for the rest of the record; None where it does not."""
    n, length = len(drive), 2 * len(drive)
    squares = np.concatenate([[0.0], np.cumsum(np.sum(drive**2, axis=1))])
    if squares[-1] == 0.0 or n < 2:
        return None
    both = np.sum(np.fft.irfft(np.abs(np.fft.rfft(drive, length, axis=0)) ** 2, length, axis=0), axis=1)
    lags = np.arange(1, n // 2 + 1)
    # What is left of the drive where it is taken from itself so much later, by sample.
    left = (squares[-1] - squares[lags] + squares[n - lags] - 2.0 * both[lags]) / (n - lags)
    # Which is known to the rounding of sums that cancel.
    same = np.flatnonzero(left < np.sqrt(np.finfo(float).eps) * squares[-1] / n)
    return int(lags[same[0]]) if len(same) else None
