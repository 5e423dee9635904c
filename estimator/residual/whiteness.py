"""Is a series white?  Portmanteau test of its autocorrelation, gaps (NaN) included."""

import math
from dataclasses import dataclass

import numpy as np

from estimator.chance import chi2_sf
from estimator.scaling import Array

LAGS, LAG_CYCLES, LAG_SHARE = 10, 2.0, 8
"""At least, in cycles of the resonance, and of the samples one in so many at most: fewer pairs tell nothing."""


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
