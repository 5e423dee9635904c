"""Overlapping Allan deviation of a rate, and how sure it is.

σ²(τ) = ½ ⟨(Ω̄₂ − Ω̄₁)²⟩, Ω̄₁ and Ω̄₂ being the means of the rate over two clusters of length τ, one right after the other
(IEEE Std 952-1997, Annex C). Where samples are missing a cluster's mean is over those there are, as long as nearly all
are; of noise of the angle itself, as quantisation, only whole clusters count. A record is gone through once, block by
block: what is kept does not grow with it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.allan.freedom import LEAST_POINTS, degrees_of_freedom, noise_type

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

LEAST_CLUSTERS = 3.0
"""A cluster length of which the record holds fewer tells nothing."""

EVERY_PLACE = 1 << 14
"""Clusters of up to so many samples are taken at every place of the record; longer ones at so many places of a cluster,
beyond which more tell nothing new."""

_PRESENT = 0.95  # of a cluster; the rest missing makes white noise 2.6 % too large at most
_TYPED = 1 << 14  # points of the angle, from the record's start, that tell the noise at a cluster length
_OCTAVE = 1100  # more than any number has below 1
_BLOCK = 1 << 15  # samples worked on at once: they stay in the processor's cache


FAR = 6.0
"""Standard deviations of the others beyond which samples are outliers: of normal noise one in 5e8 lies there."""


class Outliers(NamedTuple):
    """How many of the samples lie beyond `beyond` from the first block's median, and the farthest [rad/s]."""

    number: int
    samples: int
    beyond: float
    farthest: float


@dataclass(frozen=True)
class AllanDeviation:
    """`deviation` (k,) in the unit of the rate, at cluster lengths `tau_s` (k,) of which there are `clusters` (k,).

    freedom (k,): equivalent degrees of freedom of σ² as an estimate, for the noise of `alpha` (k,), which is what the
    record shows at that length; see `estimator.allan.freedom`.
    """

    tau_s: Floats
    deviation: Floats
    clusters: Floats
    freedom: Floats
    alpha: Floats

    def __len__(self) -> int:
        return self.tau_s.size

    @property
    def relative_sd(self) -> Floats:
        """Standard deviation of the deviation over itself (k,): 1/√(2 · degrees of freedom)."""
        return np.asarray(1.0 / np.sqrt(2.0 * self.freedom))

    def interval(self, probability: float) -> tuple[Floats, Floats]:
        """Ends (k,) of the interval of that probability: σ² is distributed as χ² over its degrees of freedom."""
        tail = 0.5 * (1.0 - probability)
        most, least = _chi_square(1.0 - tail, self.freedom), _chi_square(tail, self.freedom)
        return self.deviation * np.sqrt(self.freedom / most), self.deviation * np.sqrt(self.freedom / least)


def allan_deviation(rate: Floats, tick: Ints, sample_rate_Hz: float, lengths: Ints | None = None) -> AllanDeviation:
    """Deviation of `rate` (n,), sampled at `tick` (n,), rising, of `sample_rate_Hz`; samples may be missing.

    lengths: samples per cluster; by default √2 apart, from one sample on. Lengths of which there are fewer than
    `LEAST_CLUSTERS` are left out.
    """
    if rate.size < LEAST_CLUSTERS:
        return AllanDeviation(*np.zeros((5, 0)))
    sums = AllanSums(int(tick[-1] - tick[0]) + 1, lengths)
    sums.add(rate, tick)
    return sums.deviation(sample_rate_Hz)


class AllanSums:
    """The deviation of a record of `span` ticks that comes in blocks. Samples farther than `within` from the first
    block's median count as missing."""

    def __init__(self, span: int, lengths: Ints | None = None, within: float = np.inf) -> None:
        left = _lengths(span) if lengths is None else lengths[span >= LEAST_CLUSTERS * lengths]
        self._levels: list[_Level] = []
        while not self._levels or left.size:
            step = 1 << len(self._levels)
            here = left <= EVERY_PLACE * step
            self._levels.append(_Level(step, np.unique(np.round(left[here] / step).astype(np.int64))))
            left = left[~here]
        self._span = span
        self._about, self._first = 0.0, -1
        self._within, self._farthest = within, 0.0
        self._octaves = np.zeros((2, 2 * _OCTAVE))  # of the distance from the median: samples, and their squares
        self._base, self._count = 0.0, 0
        self._due = 0  # tick that comes next, of those since the first
        self._feed(np.zeros(1), np.zeros(1, np.int64))

    def add(self, rate: Floats, tick: Ints) -> None:
        """The samples that follow (n,), at rising ticks."""
        if self._first < 0 and rate.size:
            self._about, self._first = float(np.median(rate)), int(tick[0])
        far = np.abs(rate - self._about)
        octave = np.frexp(np.maximum(far, np.finfo(float).tiny))[1] + _OCTAVE
        for sums, weight in zip(self._octaves, (None, far**2), strict=True):
            sums += np.bincount(octave, weight, sums.size)
        self._farthest = max(self._farthest, float(far.max(initial=0.0)))
        if self._farthest > self._within:
            rate, tick = rate[far <= self._within], tick[far <= self._within]
        place = tick - self._first
        at = 0
        while at < rate.size:
            end = int(np.searchsorted(place, self._due + _BLOCK))
            until = int(place[end - 1]) + 1 if end == rate.size else self._due + _BLOCK
            if end - at == until - self._due:
                values, there = rate[at:end] - self._about, np.ones(end - at, np.int64)
            else:
                values, there = np.zeros(until - self._due), np.zeros(until - self._due, np.int64)
                values[place[at:end] - self._due] = rate[at:end] - self._about
                there[place[at:end] - self._due] = 1
            self._feed(np.cumsum(values), self._count + np.cumsum(there))
            self._due, at = until, end

    def outliers(self) -> Outliers | None:
        """Of what has come, octave by octave from the farthest on."""
        counts, squares = (np.cumsum(sums) for sums in self._octaves)
        beyond = None
        for k in np.flatnonzero(self._octaves[0])[:0:-1]:
            if not 0.0 < FAR * np.sqrt(squares[k - 1] / counts[k - 1]) < 2.0 ** (k - 1 - _OCTAVE):
                break
            beyond = k
        if beyond is None:
            return None
        number = int(counts[-1] - counts[beyond - 1])
        return Outliers(number, int(counts[-1]), 2.0 ** float(beyond - 1 - _OCTAVE), self._farthest)

    def _feed(self, angle: Floats, count: Ints) -> None:
        """The sums from the last block's end on go down the levels; the next are counted from where they end."""
        passed = float(angle[-1])
        self._count = int(count[-1])
        for level in self._levels:
            angle, count = level.add(angle, count, self._base)
            level.count_from(passed)
        self._base += passed

    def deviation(self, sample_rate_Hz: float) -> AllanDeviation:
        """Of what has come."""
        rows: list[tuple[float, ...]] = []
        alpha = 0
        for level in self._levels:
            for k, length in enumerate(level.lengths.tolist()):
                points = np.concatenate(level.typed[k])
                alpha = noise_type(points) if points.size >= LEAST_POINTS else alpha
                partly = int(alpha <= 0)  # noise of the angle itself does not outlast a gap
                places = max(self._span // level.step - 2 * length + 1, 1)
                share, samples = level.used[k, partly] / places, length * level.step
                clusters = share * self._span / samples
                if clusters < LEAST_CLUSTERS:
                    continue
                freedom = share * degrees_of_freedom(alpha, length, places + 2 * length)
                deviation = np.sqrt(0.5 * level.squares[k, partly] / level.used[k, partly])
                rows.append((samples / sample_rate_Hz, deviation, clusters, freedom, alpha))
        return AllanDeviation(*np.array(rows).reshape(-1, 5).T)


class _Level:
    """Clusters of `lengths` (k,) steps of so many samples, taken at every step.

    squares, used (k, 2): sum of the squared differences of neighbours, and how many; of whole ones, and of all usable.
    """

    def __init__(self, step: int, lengths: Ints) -> None:
        self.step, self.lengths = step, lengths
        self.squares, self.used = np.zeros((lengths.size, 2)), np.zeros((lengths.size, 2))
        self.typed: list[list[Floats]] = [[] for _ in range(lengths.size)]
        self._room = [_TYPED] * lengths.size
        self._kept = 2 * int(lengths.max(initial=0))
        self._seen = 0
        self._angle, self._number = np.zeros(0), np.zeros(0, np.int64)

    def count_from(self, passed: float) -> None:
        """What was kept counts from a later point, where the angle is `passed` further."""
        self._angle -= passed

    def add(self, angle: Floats, number: Ints, base: float) -> tuple[Floats, Ints]:
        """Points that follow (n,), the angle counted from where it is `base`, and the number of samples up to each;
        every other of them, which the next level takes."""
        every_other = slice(self._seen % 2, None, 2)
        there, before = np.concatenate([self._angle, angle]), self._angle.size
        numbers = np.concatenate([self._number, number])
        whole = numbers.size > 0 and int(numbers[-1] - numbers[0]) == (numbers.size - 1) * self.step
        twice, room = 2.0 * there, np.empty(angle.size)
        for k, m in enumerate(self.lengths.tolist()):
            self._type(k, m, angle, base)
            start = max(before, 2 * m)
            ends = [slice(start - back, there.size - back) for back in (0, m, 2 * m)]
            if start >= there.size:
                continue
            if whole:
                difference = np.add(there[ends[0]], there[ends[2]], out=room[: there.size - start])
                difference -= twice[ends[1]]
                self.squares[k] += float(difference @ difference) / (m * self.step) ** 2
                self.used[k] += difference.size
                continue
            second, first = there[ends[0]] - there[ends[1]], there[ends[1]] - there[ends[2]]
            after, until = numbers[ends[0]] - numbers[ends[1]], numbers[ends[1]] - numbers[ends[2]]
            for partly, least in enumerate((1.0, _PRESENT)):
                usable = np.minimum(after, until) >= least * m * self.step
                difference = second[usable] / after[usable] - first[usable] / until[usable]
                self.squares[k, partly] += float(difference @ difference)
                self.used[k, partly] += difference.size
        self._seen += angle.size
        self._angle, self._number = there[there.size - self._kept :], numbers[numbers.size - self._kept :]
        if there.size < self._kept:
            self._angle, self._number = there, numbers
        return angle[every_other], number[every_other]

    def _type(self, k: int, m: int, angle: Floats, base: float) -> None:
        """Keep what tells the noise at a length: points of the angle that far apart."""
        if self._room[k] > 0:
            points = angle[-self._seen % m :: m][: self._room[k]] + base
            self._room[k] -= points.size
            self.typed[k].append(points)


def _lengths(span: int) -> Ints:
    longest = span / LEAST_CLUSTERS
    steps = np.arange(int(2 * np.log2(max(longest, 1.0))) + 1)
    return np.unique(np.round(2.0 ** (steps / 2)).astype(np.int64))


def _chi_square(probability: float, freedom: Floats) -> Floats:
    """Quantile of χ²."""
    from scipy.special import gammaincinv

    return np.asarray(2.0 * gammaincinv(freedom / 2.0, probability), np.float64)
