"""What a noise is: its level, and whether it is white."""

from collections.abc import Callable

import numpy as np

from estimator.chance import chi2_sf
from estimator.correlation import autocorrelation
from estimator.scaling import Array

LAGS = 20
"""Over which a series is asked whether it is white."""


def level(likelihood: Callable[[float], float], start: float, between: tuple[float, float], close: float) -> float:
    """The decade with the largest likelihood next to `start`, to within `close`: steps down first, then up, each that
    rises twice as long as the one before.
    """
    lowest, highest = between
    known = {start: likelihood(start)}
    best, step, failed = start, -close, 0
    while failed < 2:
        tried = min(max(best + step, lowest), highest)
        if tried not in known:
            known[tried] = likelihood(tried)
        if known[tried] > known[best]:
            best, step, failed = tried, 2.0 * step, 0
        elif abs(step) > close:
            step = close if step > 0.0 else -close
        else:
            step, failed = -step, failed + 1
    return best


def ljung_box(series: Array) -> float:
    """Chance of an autocorrelation as large in white noise (Ljung & Box, Biometrika 65, 1978); 1 of zeros."""
    n = len(series)
    lags = np.arange(1, min(LAGS, n // 4) + 1)
    if not len(lags) or not np.any(series):
        return 1.0
    statistic = n * (n + 2.0) * float(np.sum(autocorrelation(series)[lags] ** 2 / (n - lags)))
    return chi2_sf(statistic, len(lags))
