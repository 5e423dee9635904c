"""Densities of power averaged over segments (P. D. Welch, IEEE Trans. Audio Electroacoustics 15(2), 1967).

The same to rounding as `scipy.signal.csd`, which takes half a second to load: every run shows one of these.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.scaling import Array


def cross_density(one: Array, other: Array, rate_Hz: float, segment: int) -> tuple[Array, NDArray[np.complex128]]:
    """Frequencies (m,) in Hz and the one-sided cross density (m, …) per Hz of two series (n, …), along the first axis.

    Segments of so many samples, no more than there are, lie half over each other, each about its mean under a Hann
    window.
    """
    segment = min(segment, len(one))
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(segment) / segment)
    step = segment - segment // 2
    count = (len(one) - segment) // step + 1
    shape = (segment, *[1] * (one.ndim - 1))
    total = np.zeros((segment // 2 + 1, *one.shape[1:]), complex)
    for k in range(count):
        rows = slice(k * step, k * step + segment)
        first, second = (
            np.fft.rfft((series[rows] - np.mean(series[rows], axis=0)) * window.reshape(shape), axis=0)
            for series in (one, other)
        )
        total += np.conj(first) * second
    total /= count * rate_Hz * np.sum(window**2)
    total[1 : -1 if segment % 2 == 0 else None] *= 2.0
    return np.asarray(np.fft.rfftfreq(segment, 1.0 / rate_Hz), float), total


def power_density(series: Array, rate_Hz: float, segment: int) -> tuple[Array, Array]:
    """The same of a series with itself."""
    frequency, density = cross_density(series, series, rate_Hz, segment)
    return frequency, np.ascontiguousarray(density.real)
