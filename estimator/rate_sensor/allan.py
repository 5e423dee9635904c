"""Overlapping Allan deviation of a rate, and how sure it is.

σ²(τ) = ½ ⟨(Ω̄₂ − Ω̄₁)²⟩, Ω̄₁ and Ω̄₂ being the means of the rate over two clusters of length τ, one right after the other,
at every place of the record (IEEE Std 952-1997, Annex C). Where samples are missing a cluster's mean is over those
there are, as long as nearly all are.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

LEAST_CLUSTERS = 3.0
"""A cluster length of which the record holds fewer tells nothing."""

_PRESENT = 0.95  # of a cluster; the rest missing makes white noise 2.6 % too large at most
_PLACES_PER_CLUSTER = 256  # of white or slower noise more of them tell nothing new


@dataclass(frozen=True)
class AllanDeviation:
    """`deviation` (k,) in the unit of the rate, at cluster lengths `tau_s` (k,) of which there are `clusters` (k,).

    freedom (k,): degrees of freedom of σ² as an estimate. The standard has the number of clusters less one, which
    overlapping only betters; half of that for clusters of one sample, where neighbouring differences share a sample
    and nothing overlaps (white phase noise, the worst case of NIST SP 1065, section 5.4.1).
    """

    tau_s: Floats
    deviation: Floats
    clusters: Floats
    freedom: Floats

    def __len__(self) -> int:
        return self.tau_s.size

    @property
    def relative_sd(self) -> Floats:
        """Standard deviation of the deviation over itself (k,): 1/√(2 (clusters − 1))."""
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
        return AllanDeviation(*np.zeros((4, 0)))
    place = tick - tick[0]
    span = int(place[-1]) + 1
    wanted = _lengths(span) if lengths is None else lengths
    values = np.zeros(span)
    values[place] = rate - rate.mean()
    sums = np.concatenate([[0.0], np.cumsum(values)])
    missing = None
    if rate.size < span:
        absent = np.ones(span, np.int64)
        absent[place] = 0
        missing = np.concatenate([[0], np.cumsum(absent)])
    rows = []
    for m in wanted.tolist():
        if span < LEAST_CLUSTERS * m:
            continue
        variance, usable = _variance(sums, missing, m)
        clusters = usable * span / m
        if clusters >= LEAST_CLUSTERS:
            freedom = (clusters - 1.0) * (0.5 if m == 1 else 1.0)
            rows.append((m / sample_rate_Hz, np.sqrt(variance), clusters, freedom))
    return AllanDeviation(*np.array(rows).reshape(-1, 4).T)


def _variance(sums: Floats, missing: Ints | None, m: int) -> tuple[float, float]:
    """Allan variance for clusters of m samples, and the share of the places where there are two."""
    stride = max(1, m // _PLACES_PER_CLUSTER)
    end = sums.size - 2 * m
    first, second = (sums[k + m : k + m + end : stride] - sums[k : k + end : stride] for k in (0, m))
    if missing is None:
        return 0.5 * float(np.mean(((second - first) / m) ** 2)), 1.0
    here, there = (m - (missing[k + m : k + m + end : stride] - missing[k : k + end : stride]) for k in (0, m))
    whole = np.minimum(here, there) >= _PRESENT * m
    if not whole.any():
        return 0.0, 0.0
    difference = second[whole] / there[whole] - first[whole] / here[whole]
    return 0.5 * float(np.mean(difference**2)), float(whole.mean())


def _lengths(span: int) -> Ints:
    longest = span / LEAST_CLUSTERS
    steps = np.arange(int(2 * np.log2(max(longest, 1.0))) + 1)
    return np.unique(np.round(2.0 ** (steps / 2)).astype(np.int64))


def _chi_square(probability: float, freedom: Floats) -> Floats:
    """Quantile of χ²."""
    from scipy.special import gammaincinv

    return np.asarray(2.0 * gammaincinv(freedom / 2.0, probability), np.float64)
