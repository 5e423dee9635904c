"""What a noise is: its level, how far it hangs on its own past, whether it is white."""

from collections.abc import Callable

import numpy as np

from estimator.chance import chi2_sf
from estimator.scaling import Array

LAGS = 20
"""Over which a series is asked whether it is white."""
FEWEST = 4.0
"""Independent samples that a series is worth, however it is correlated."""
TWO_SIDED = 1.959963984540054
"""Standard deviations to either side of a normal distribution's mean that hold 95 %."""


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


def autocorrelation(series: Array) -> Array:
    """Of a series (n,) about its mean at lags from 0 to n − 1, over its power; 0 of one that is constant."""
    centred = series - np.mean(series)
    padded = 2 * len(centred)
    products = np.fft.irfft(np.abs(np.fft.rfft(centred, padded)) ** 2, padded)[: len(centred)]
    return np.asarray(products / max(float(products[0]), np.finfo(float).tiny))


def effective_samples(residual: Array) -> float:
    """n / (1 + 2 Σ ρ) of a series (n,), its autocorrelation summed up to where it first reaches zero; at most n."""
    correlation = autocorrelation(residual)
    first = int(np.argmax(correlation <= 0.0)) or len(correlation)
    worth = len(residual) / (1.0 + 2.0 * np.sum(correlation[1:first]))
    return float(np.clip(worth, min(FEWEST, len(residual)), len(residual)))


def ljung_box(series: Array) -> float:
    """Chance of an autocorrelation as large in white noise (Ljung & Box, Biometrika 65, 1978); 1 of zeros."""
    n = len(series)
    lags = np.arange(1, min(LAGS, n // 4) + 1)
    if not len(lags) or not np.any(series):
        return 1.0
    statistic = n * (n + 2.0) * float(np.sum(autocorrelation(series)[lags] ** 2 / (n - lags)))
    return chi2_sf(statistic, len(lags))
