"""Is a series white?  Portmanteau test of its autocorrelation, and test of its cumulative periodogram.

The first sees short memory, the second a spectrum that is lopsided as a whole.  Both have exact or nearly exact
chances under white noise, gaps (NaN) included.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import kolmogorov

from estimator.chance import chi2_sf
from estimator.scaling import Array

LAGS, LAG_CYCLES, LAG_SHARE = 10, 2.0, 8
"""At least, in cycles of the resonance, and of the samples one in so many at most: fewer pairs tell nothing."""
LIMITING = 1_000
"""Ordinates from which on the limiting distribution is right to two parts in a hundred of any chance that is told."""


@dataclass(frozen=True)
class Whiteness:
    """Probability, under white noise, of a statistic this large or larger."""

    statistic: float
    p: float
    log_p: float


def sensible_lags(samples: int, samples_per_cycle: float) -> int:
    """Two cycles of the resonance, at least ten lags, at most an eighth of the record."""
    return max(1, min(max(LAGS, math.ceil(LAG_CYCLES * samples_per_cycle)), samples // LAG_SHARE))


def portmanteau(series: Array, lags: int) -> Whiteness:
    """Test of Ljung and Box (1978) on series (n,) or (n, axes), in the multivariate form of Hosking (1980).

    Over several axes the correlations between them at lags other than zero count as well; NaN rows are left out.
    """
    white, valid = _whitened(series)
    n, axes = white.shape
    total = int(np.sum(valid))
    known = valid.astype(float)
    statistic = 0.0
    for lag in range(1, lags + 1):
        pairs = n - lag if total == n else float(known[lag:] @ known[:-lag])
        if pairs > 0:
            statistic += float(np.sum((white[lag:].T @ white[:-lag]) ** 2)) / pairs
    statistic *= (total + 2.0) / total
    degrees = axes**2 * lags
    return Whiteness(statistic, chi2_sf(statistic, degrees), _log_chi2(statistic, degrees))


def cumulative_periodogram(series: Array) -> Whiteness:
    """Largest distance of the cumulative periodogram of series (n,) from a straight line (Bartlett 1955).

    Under white noise it is distributed as Kolmogorov's and Smirnov's statistic.
    """
    filled = np.nan_to_num(series - np.nanmean(series))
    power = np.abs(np.fft.rfft(filled)) ** 2
    power = power[1 : (len(filled) + 1) // 2]  # without the mean and, where there is one, the line at half the rate
    share = np.cumsum(power)[:-1] / np.sum(power)
    count = len(share)
    rank = np.arange(1, count + 1)
    distance = float(max(np.max(rank / count - share), np.max(share - (rank - 1) / count)))
    if count < LIMITING:
        from scipy.stats import kstwo  # half a second, for short series alone

        p = float(kstwo.sf(distance, count))
    else:
        root = math.sqrt(count)
        p = float(kolmogorov((root + 0.12 + 0.11 / root) * distance))  # Stephens 1970
    log_p = math.log(p) if p > 0.0 else math.log(2.0) - 2.0 * count * distance**2
    return Whiteness(distance, p, log_p)


def _whitened(series: Array) -> tuple[Array, Array]:
    """The series without mean and correlation at lag zero, 0 where it has a gap; and where it has none (n,)."""
    columns = np.asarray(series, dtype=float).reshape(len(series), -1)
    valid = np.all(np.isfinite(columns), axis=1)
    known = columns[valid] - np.mean(columns[valid], axis=0)
    root = np.linalg.cholesky(known.T @ known / len(known))
    white = np.zeros_like(columns)
    white[valid] = np.linalg.solve(root, known.T).T
    return white, valid


def _log_chi2(statistic: float, degrees: int) -> float:
    """log of the upper tail; where it underflows, the leading term of its asymptotic series."""
    if (p := chi2_sf(statistic, degrees)) > 0.0:
        return math.log(p)
    half, order = statistic / 2.0, degrees / 2.0
    return (order - 1.0) * math.log(half) - half - math.lgamma(order)
