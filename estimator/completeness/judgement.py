"""Whether anything is left that the model, with what was found, does not account for.

A long record shows the smallest of imperfections: what counts is not whether the residual could be told from white
noise, but whether what stands above it is of a size that matters.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri

from estimator.correlation import autocorrelation
from estimator.record import Record
from estimator.residual.floor import floor_deviation, quiet_bins
from estimator.residual.spectrum import lines, periodogram
from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS

_SET = THRESHOLDS.judgement


def left_in(
    innovation: Array, deviation: Array, noise: Sequence[float], record: Record, resonance_hz: float
) -> tuple[str, ...]:
    """What in innovations (n, axes) with their predicted deviations is larger than can be left to chance, in words;
    noise (axes,) V: declared of the sensors.
    """
    sample_rate = 1.0 / float(np.mean(record.step))
    cycle = int(sample_rate / resonance_hz)  # a record has four samples of one at least
    first = _SET.start * cycle
    series = steadied(innovation, deviation, first, cycle)
    reasons = []
    power, spread = power_over_prediction(deviation, noise, series, first, sample_rate, resonance_hz)
    if power - 1.0 > max(_SET.level, -float(ndtri(THRESHOLDS.promises.floor_chance)) * spread):
        reasons.append(f"the innovation is {np.sqrt(power):.3g} × what its prediction and the noise floor allow")
    share = predictable_share(series, _SET.lags * cycle)
    # What a jump of the rate leaves is as much in a short record as in a long one, and the larger a share of it.
    shortness = max(1.0, _SET.short / len(series))
    if share > shortness * _SET.predictable:
        how_much = f"{share:.1%}" if share < 1.0 else "nearly all"
        reasons.append(f"{how_much} of the innovation can be predicted from those before")
    spectrum = periodogram(series, sample_rate, resonance_hz)
    for line in lines(spectrum, sample_rate, resonance_hz, _SET.line_chance):
        allowed = shortness * _SET.rate_power if line.order == 1 else _SET.line_power
        if line.rms**2 > allowed * float(np.sum(np.nanmean(series**2, axis=0))):
            reasons.append(f"a line is left at {line.frequency:.6g} Hz")
            break
    return tuple(reasons)


def steadied(innovation: Array, deviation: Array, first: int, cycle: int) -> Array:
    """Innovations from `first` on over their predicted deviation (m, axes), those around a jump of the rate reduced."""
    normalised = np.nan_to_num(innovation / deviation)[first:]
    power = np.convolve(np.mean(normalised**2, axis=1), np.ones(cycle), "same")  # over a cycle
    usual = float(np.median(power))
    share = np.sqrt(np.minimum(1.0, _SET.jump * usual / np.maximum(power, np.finfo(float).tiny)))
    return np.asarray(normalised * share[:, None])


def power_over_prediction(
    deviation: Array, noise: Sequence[float], series: Array, first: int, sample_rate: float, resonance_hz: float
) -> tuple[float, float]:
    """Power of the steadied innovations over what was predicted, were the noise what the record's floor says; and its
    standard deviation by chance: a short record does not tell its floor to a twentieth.
    """
    spectrum = periodogram(series, sample_rate, resonance_hz)
    quiet = quiet_bins(spectrum.frequency, sample_rate, resonance_hz)
    floor = np.median(spectrum.density[quiet], axis=0) / np.log(2.0) * sample_rate / 2.0
    predicted = deviation[first:] ** 2
    # The floor is the noise's, the rest of the prediction the estimate's own uncertainty.
    share = np.array(noise) ** 2 / predicted
    allowed = np.nanmean(1.0 + (np.minimum(floor, _SET.most_floor) - 1.0) * share, axis=0)
    power = float(np.mean(np.mean(series**2, axis=0) / np.maximum(allowed, np.finfo(float).tiny)))
    # Both are of the same samples, and the power is the better estimate of noise: the variances subtract (Hausman,
    # Econometrica 46(6), 1978).
    by_chance = floor_deviation(int(np.sum(quiet))) ** 2 - 2.0 / len(series)
    return power, float(np.sqrt(max(by_chance, 0.0) / series.shape[1]))


def predictable_share(series: Array, lags: int) -> float:
    """Share of the power that the sum of squared autocorrelations puts down to the past, chance taken off."""
    shares = [np.sum(autocorrelation(column)[1 : lags + 1] ** 2 - 1.0 / len(series)) for column in series.T]
    return float(np.mean(shares))
