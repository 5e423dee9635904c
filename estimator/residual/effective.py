"""How many independent samples a correlated series is worth."""

import numpy as np

from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS


def effective_samples(residual: Array) -> float:
    """n / (1 + 2 Σ ρ) of a series (n,), its autocorrelation summed up to where it first reaches zero; at most n."""
    centred = residual - np.mean(residual)
    power = float(centred @ centred)
    if power == 0.0:
        return float(len(residual))
    spectrum = np.fft.rfft(centred, 2 * len(centred))
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[: len(centred)] / power
    first = int(np.argmax(correlation <= 0.0)) or len(correlation)
    worth = len(residual) / (1.0 + 2.0 * np.sum(correlation[1:first]))
    return float(np.clip(worth, THRESHOLDS.residual.fewest_independent, len(residual)))
