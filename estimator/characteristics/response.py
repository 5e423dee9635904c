"""Bandwidth and delay: the output's spectrum over that of the reference (Welch; intervals by Bendat & Piersol, Random
Data, 4th ed., table 9.6)."""

import numpy as np
import numpy.typing as npt

from estimator.chance import TWO_SIDED
from estimator.characteristics.regression import Estimate, Floats

_COHERENT = 0.6
_SEGMENTS, _SEGMENT = 16, 16
_ROUNDS = 9  # of moving the reference; two or three are enough where a window is longer than the delay
_TONE, _BESIDE = 4, 0.01  # lines of the spectrum on either side of the largest; least share of the power beyond
_STEPS = 16  # from two terms to as many as there are frequencies
LEAST = _SEGMENT * (_SEGMENTS + 1) // 2
"""Samples of which there is a response, at least."""
_REPEATED = 35.0 / 18.0
"""Variance of a mean over frequencies, over that of independent ones: behind a Hann window neighbours correlate."""
_DOWN = 10.0 ** (-3.0 / 20.0)


def response(rate: Floats, reference: Floats, sample_rate_Hz: float) -> dict[str, Estimate]:
    """`bandwidth` and `delay` of `rate` (n,) behind `reference` (n,), uniform samples without a gap.

    Only frequencies at which both move together count; without any there is nothing, and without the −3 dB point among
    them no bandwidth. A tone leads to no other frequency: nothing as well. The delay is that of the lowest frequencies.
    Windows of a late output show less than its delay, so the reference is moved by what was found until nothing is left
    (Bendat & Piersol, section 9.1.2).
    """
    if rate.size < LEAST or (both := _together(rate, reference, sample_rate_Hz)) is None:
        return {}
    t_s = np.arange(rate.size) / sample_rate_Hz
    at, gain, _, off = both
    delay, half = _delay(*both)
    left = delay
    for _ in range(_ROUNDS):
        if abs(left) < 0.1 * half:
            break
        if (both := _together(rate, np.interp(t_s - delay, t_s, reference), sample_rate_Hz)) is None:
            return {}
        left, half = _delay(*both)
        delay += left
    found = {"delay": Estimate.about(delay, half)}
    start = float(np.median(gain[: max(2, np.count_nonzero(_low(at)) // 2)]))
    crossing = [_crossing(at, gain * (1.0 + sign * TWO_SIDED * off) / start) for sign in (-1.0, 0.0, 1.0)]
    least, value, most = crossing
    if value is not None:
        found["bandwidth"] = Estimate(value, least or value, most or float(at[-1]))
    return found


def _together(rate: Floats, reference: Floats, sample_rate_Hz: float) -> tuple[Floats, Floats, Floats, Floats] | None:
    """Where both move together, (k,) each: frequency, gain, phase, standard deviation of the phase; None of nothing."""
    from scipy.signal import coherence, csd, welch

    size = 2 ** int(np.log2(2 * rate.size // (_SEGMENTS + 1)))
    given = {"fs": sample_rate_Hz, "nperseg": size, "detrend": "linear"}
    f, across = csd(reference, rate, **given)
    _, power = welch(reference, **given)
    _, together = coherence(reference, rate, **given)
    averages = (2 * rate.size // size - 1) * 0.75  # half overlapping Hann windows
    told = (together > _COHERENT) & (f > 0.0) & (power > 1e-6 * power.max())
    largest = int(np.argmax(power))
    tone = float(power[max(largest - _TONE, 0) : largest + _TONE + 1].sum())
    if np.count_nonzero(told) < 2 or float(power.sum()) - tone < _BESIDE * tone:
        return None
    off = np.sqrt(np.maximum(1.0 - together[told], 0.0) / (2.0 * together[told] * averages))  # by rounding below 0
    return f[told], np.abs(across[told]) / power[told], np.unwrap(np.angle(across[told])), off


def _low(at: Floats) -> npt.NDArray[np.bool_]:
    return np.asarray(at <= max(at[0] * 3.0, at[-1] / 10.0))


def _delay(at: Floats, gain: Floats, phase: Floats, off: Floats) -> tuple[float, float]:
    """Delay at the frequency 0, and half its interval: the phase of the low ones is −τ ω + c ω³ + …, in as many terms
    as leave no more than noise."""
    low = _low(at)
    most, sd = 2.0 * np.pi * float(at[low][-1]), np.maximum(off[low], 1e-9)
    seen, share = phase[low] / sd, at[low] / at[low][-1]  # of the highest frequency, so that no power overflows
    for terms in np.unique(np.geomspace(min(2, share.size), share.size, _STEPS).astype(int)):
        columns = np.column_stack([most * share ** (2 * k + 1) for k in range(terms)]) / sd[:, None]
        scale = np.linalg.norm(columns, axis=0)
        inverse = np.linalg.pinv(columns / scale) / scale[:, None]
        if float(np.sum((seen - columns @ inverse @ seen) ** 2)) <= _REPEATED * (share.size - terms):
            break
    return -float(inverse[0] @ seen), TWO_SIDED * float(np.sqrt(_REPEATED) * np.linalg.norm(inverse[0]))


def _crossing(f: Floats, gain: Floats) -> float | None:
    below = np.flatnonzero(gain < _DOWN)
    if not below.size or below[0] == 0:
        return None
    k = int(below[0])
    share = (gain[k - 1] - _DOWN) / (gain[k - 1] - gain[k])
    return float(f[k - 1] + share * (f[k] - f[k - 1]))
