"""Spectrum of the innovation, its floor, and the lines that stand above it more than chance allows."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, betaln

from estimator.residual.averaged import power_density
from estimator.residual.significance import of_many
from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS

_SET = THRESHOLDS.spectrum

ORDERS = _SET.orders  # multiples of the resonance that are looked at, beside 0
BAND = 1.0 / 16.0  # resonances: half width of what is shown around a multiple
LOBE = 3  # bins to either side: a line under a Hann window fills them
_LISTED = 24  # lines at most; candidates are fewer of the strongest
_CORRELATED = 1.94  # by how much a Hann window's bins correlate: 1 + 2 (4/9 + 1/36)


def floor_deviation(count: int) -> float:
    """Relative standard deviation of a power that is the median of so many bins; of a median of exponentials, n bins of
    a Hann window being as good as n/1.94 independent ones.
    """
    return math.sqrt(_CORRELATED / max(count, 1)) / math.log(2.0)


FLOOR_BINS = math.ceil((floor_deviation(1) / 2.0 / (THRESHOLDS.criterion.floor - 1.0)) ** 2)
"""Bins that tell a floor, of which an amplitude is known to half of what a power is, to what a complete model may leave
beside it.
"""


@dataclass(frozen=True)
class Periodogram:
    """One-sided density (m, axes) V²/Hz at frequency (m,) Hz of a Hann window over the whole record.

    floor (m, axes): local floor; degrees: how many degrees of freedom that floor has; transform (m, axes) for the
    interpolation between bins.
    """

    frequency: Array
    density: Array
    floor: Array
    degrees: float
    transform: NDArray[np.complex128]

    @property
    def spacing(self) -> float:
        """Hz between bins."""
        return float(self.frequency[1] - self.frequency[0])

    @property
    def ordinates(self) -> Array:
        """Density over floor, summed over the axes (m,): a sum of unit exponentials under white noise."""
        return np.asarray(np.sum(self.density / self.floor, axis=1))


@dataclass(frozen=True)
class Line:
    """A line: frequency [Hz], rms [V] over the axes, logarithm of its chance over all bins searched.

    order: the multiple of the resonance it is at or a sideband of, None elsewhere; offset [Hz] from that multiple.
    """

    frequency: float
    rms: float
    log_p: float
    order: int | None
    offset: float


@dataclass(frozen=True)
class Band:
    """What stands above the floor around a multiple of the resonance: rms [V] over the axes, and its chance."""

    order: int
    frequency: float
    rms: float
    log_p: float


def density(series: Array, sample_rate: float) -> tuple[Array, Array]:
    """Welch's estimate for figures: frequency (m,) Hz and one-sided density (m, axes) V²/Hz of series (n, axes)."""
    segment = int(min(8192, max(64, 2 ** int(math.log2(max(len(series) // 8, 64))))))
    frequency, power = power_density(np.nan_to_num(series), sample_rate, segment)
    return np.asarray(frequency[1:]), np.asarray(power[1:])


def summed_power(sense: Array) -> Array:
    """Power (n // 2 + 1,) of all channels of sense (n, axes) together, each about its mean under a Hann window, of no
    unit; gaps (NaN) count as zero.
    """
    centred = np.nan_to_num(sense - np.nanmean(sense, axis=0)) * np.hanning(len(sense))[:, None]
    return np.asarray(np.sum(np.abs(np.fft.rfft(centred, axis=0)) ** 2, axis=1))


def periodogram(series: Array, sample_rate: float, resonance: float) -> Periodogram:
    """Of series (n, axes) in volts; gaps (NaN) count as zero, and their share is made up for."""
    n = len(series)
    valid = np.isfinite(series)
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(n) + 0.5) / n)
    there = np.maximum(np.sum(valid, axis=0), 1)  # a channel may have none: its observer diverged at once
    centred = np.where(valid, series - np.sum(series, axis=0, where=valid) / there, 0.0)
    transform = np.fft.rfft(centred * window[:, None], axis=0)
    scale = 2.0 / (sample_rate * np.sum(window[:, None] ** 2 * valid, axis=0))
    rows = slice(1, (n + 1) // 2)
    transform = transform[rows]
    frequency = np.asarray(np.fft.rfftfreq(n, 1.0 / sample_rate)[rows], dtype=float)
    power = np.asarray(np.abs(transform) ** 2 * scale, dtype=float)
    floor, degrees = _local_floor(power, frequency, resonance)
    return Periodogram(frequency, power, floor, degrees, transform)


def _local_floor(power: Array, frequency: Array, resonance: float) -> tuple[Array, float]:
    """Median of blocks over ln 2, which a line within moves little, joined by straight lines; degrees of freedom."""
    bins = len(frequency)
    # As wide as the resonance is high: one multiple of it in each.
    width = max(FLOOR_BINS, math.ceil(resonance / (frequency[1] - frequency[0])))
    edges = np.linspace(0, bins, max(bins // width, 1) + 1).astype(int)
    blocks = [slice(start, stop) for start, stop in pairwise(edges)]
    middles = np.array([np.mean(frequency[block]) for block in blocks])
    medians = np.array([np.median(power[block], axis=0) for block in blocks]) / math.log(2.0)
    floor = np.stack([np.interp(frequency, middles, column) for column in medians.T], axis=1)
    count = bins / len(blocks)
    return np.maximum(floor, np.finfo(float).tiny), 2.0 * count * math.log(2.0) ** 2 / _CORRELATED


def folded(frequency: float, sample_rate: float) -> float:
    """Where a frequency shows in samples taken at `sample_rate`."""
    return abs((frequency + sample_rate / 2.0) % sample_rate - sample_rate / 2.0)


def bands(spectrum: Periodogram, sample_rate: float, resonance: float) -> tuple[Band, ...]:
    """Power above the floor around 0 and the first multiples of the resonance, each with its own chance."""
    found = []
    axes = spectrum.density.shape[1]
    for order in range(ORDERS + 1):
        centre = folded(order * resonance, sample_rate)
        inside = np.abs(spectrum.frequency - centre) <= BAND * resonance
        count = int(np.sum(inside))
        if count < 1:
            continue
        mean = float(np.mean(spectrum.ordinates[inside])) / axes
        excess = np.sum(spectrum.density[inside] - spectrum.floor[inside]) * spectrum.spacing
        effective = max(axes * count / _CORRELATED, float(axes))
        log_p = _log_f(mean, 2.0 * effective, spectrum.degrees)
        found.append(Band(order, centre, math.sqrt(max(float(excess), 0.0)), log_p))
    return tuple(found)


def lines(spectrum: Periodogram, sample_rate: float, resonance: float, level: float) -> tuple[Line, ...]:
    """Lines that chance would put anywhere in the spectrum with less than `level`, strongest first."""
    ordinates = spectrum.ordinates
    axes = spectrum.density.shape[1]
    free = np.ones(len(ordinates), dtype=bool)
    found: list[Line] = []
    while len(found) < _LISTED:
        peak = int(np.argmax(np.where(free, ordinates, -1.0)))
        log_p = of_many(_log_tail(float(ordinates[peak]), axes, spectrum.degrees), len(ordinates))
        if not free[peak] or log_p > math.log(level):
            break
        start, stop = _extent(spectrum, peak, level)
        claimed = slice(start, stop)
        excess = np.sum(spectrum.density[claimed] - spectrum.floor[claimed]) * spectrum.spacing
        frequency = _between_bins(spectrum, peak)
        if _apart(frequency, found, spectrum.spacing):
            order, offset = _order(frequency, sample_rate, resonance)
            found.append(Line(frequency, math.sqrt(max(float(excess), 0.0)), log_p, order, offset))
        free[claimed] = False
    return tuple(found)


def _apart(frequency: float, found: list[Line], spacing: float) -> bool:
    return all(abs(frequency - line.frequency) > 2 * LOBE * spacing for line in found)


def _extent(spectrum: Periodogram, peak: int, level: float) -> tuple[int, int]:
    """Bins of a line: its lobe, and on while each has less than `level` of being floor."""
    ordinates, axes = spectrum.ordinates, spectrum.density.shape[1]

    def clear(at: int) -> bool:
        return _log_tail(float(ordinates[at]), axes, spectrum.degrees) < math.log(level)

    start, stop = max(peak - LOBE, 0), min(peak + LOBE + 1, len(ordinates))
    while start > 0 and clear(start - 1):
        start -= 1
    while stop < len(ordinates) and clear(stop):
        stop += 1
    return start, stop


def _between_bins(spectrum: Periodogram, peak: int) -> float:
    """Frequency from the two largest bins of a Hann window's lobe (Rife & Vincent 1970)."""
    size = np.abs(spectrum.transform[:, int(np.argmax(spectrum.density[peak] / spectrum.floor[peak]))])
    if peak == 0 or peak == len(size) - 1:
        return float(spectrum.frequency[peak])
    side = 1 if size[peak + 1] > size[peak - 1] else -1
    ratio = size[peak + side] / size[peak]
    return float(spectrum.frequency[peak] + side * spectrum.spacing * (2.0 * ratio - 1.0) / (ratio + 1.0))


def _order(frequency: float, sample_rate: float, resonance: float) -> tuple[int | None, float]:
    multiples = [folded(order * resonance, sample_rate) for order in range(ORDERS + 1)]
    nearest = int(np.argmin([abs(frequency - multiple) for multiple in multiples]))
    offset = frequency - multiples[nearest]
    return (nearest, offset) if abs(offset) <= _SET.sideband * resonance else (None, offset)


def _log_tail(ordinate: float, axes: int, degrees: float) -> float:
    """log P of a sum of `axes` unit exponentials over a floor that is itself an estimate: the tail of Fisher's F."""
    x = degrees / (degrees + 2.0 * ordinate)
    half = degrees / 2.0
    return half * math.log(x) + (math.log1p(half * (1.0 - x)) if axes == 2 else 0.0)


def _log_f(ratio: float, above: float, below: float) -> float:
    """log of the upper tail of F(above, below) at `ratio`; where it underflows, from the leading term."""
    x = below / (below + above * ratio)
    p = float(betainc(below / 2.0, above / 2.0, x))
    if p > 0.0:
        return math.log(p)
    a, b = below / 2.0, above / 2.0
    return a * math.log(x) + b * math.log1p(-x) - math.log(a) - float(betaln(a, b))
