"""How a series hangs on its own past, and how many independent samples it is then worth."""

import numpy as np

from estimator.scaling import Array

FEWEST = 4.0
"""Independent samples that a series is worth, however it is correlated."""


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
