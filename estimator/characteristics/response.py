"""Bandwidth and delay: the output's spectrum over that of the reference (Welch; intervals by Bendat & Piersol, Random
Data, 4th ed., table 9.6)."""

import numpy as np

from estimator.chance import TWO_SIDED
from estimator.characteristics.regression import Estimate, Floats

_COHERENT = 0.6
_SEGMENTS, _SEGMENT = 16, 16
LEAST = _SEGMENT * (_SEGMENTS + 1) // 2
"""Samples of which there is a response, at least."""
_DOWN = 10.0 ** (-3.0 / 20.0)


def response(rate: Floats, reference: Floats, sample_rate_Hz: float) -> dict[str, Estimate]:
    """`bandwidth` and `delay` of `rate` (n,) behind `reference` (n,), uniform samples without a gap.

    Only frequencies at which both move together count; without any there is nothing, and without the −3 dB point among
    them no bandwidth.
    """
    from scipy.signal import coherence, csd, welch

    if rate.size < LEAST:
        return {}
    size = 2 ** int(np.log2(2 * rate.size // (_SEGMENTS + 1)))
    given = {"fs": sample_rate_Hz, "nperseg": size, "detrend": "linear"}
    f, across = csd(reference, rate, **given)
    _, power = welch(reference, **given)
    _, together = coherence(reference, rate, **given)
    averages = (2 * rate.size // size - 1) * 0.75  # half overlapping Hann windows
    told = (together > _COHERENT) & (f > 0.0) & (power > 1e-6 * power.max())
    if np.count_nonzero(told) < 2:
        return {}
    gain = np.abs(across[told]) / power[told]
    phase = np.unwrap(np.angle(across[told]))
    off = np.sqrt((1.0 - together[told]) / (2.0 * together[told] * averages))
    found = {}
    at = f[told]
    low = at <= max(at[0] * 3.0, at[-1] / 10.0)
    weight = (2.0 * np.pi * at[low] / np.maximum(off[low], 1e-9)) ** 2
    delay = float(-np.sum(weight * phase[low] / (2.0 * np.pi * at[low])) / weight.sum())
    found["delay"] = Estimate.about(delay, TWO_SIDED / float(np.sqrt(weight.sum())))
    start = float(np.median(gain[: max(2, low.sum() // 2)]))
    crossing = [_crossing(at, gain * (1.0 + sign * TWO_SIDED * off) / start) for sign in (-1.0, 0.0, 1.0)]
    least, value, most = crossing
    if value is not None:
        found["bandwidth"] = Estimate(value, least or value, most or float(at[-1]))
    return found


def _crossing(f: Floats, gain: Floats) -> float | None:
    below = np.flatnonzero(gain < _DOWN)
    if not below.size or below[0] == 0:
        return None
    k = int(below[0])
    share = (gain[k - 1] - _DOWN) / (gain[k - 1] - gain[k])
    return float(f[k - 1] + share * (f[k] - f[k - 1]))
