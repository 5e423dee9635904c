"""What a recorded drive did between its samples, as polynomials for the exact flow.

Three answers: held (`zoh`), joined by straight lines (`foh`), or band-limited, as behind an anti-alias filter
(`bandlimited`).  On a measured oscillator the choice is worth a sixth of the residual.
"""

from math import factorial
from typing import Literal, get_args

import numpy as np

from estimator.errors import ModelError
from estimator.scaling import Array

Hold = Literal["zoh", "foh", "bandlimited"]

_DERIVATIVES = 4  # value and three derivatives at both ends of a piece: degree 7
_PREDICTOR = 64  # order of the linear prediction beyond the record's ends
_MARGIN = 256  # samples of it


def drive_polynomials(u: Array, hold: Hold) -> Array:
    """Coefficients (n, axes, degree + 1) in normalised time of the interval that ends at each sample, from u (n, axes).

    zoh: u[m] acted over the whole interval that ends at sample m.  foh, bandlimited: u[m] is the value at sample m.
    Before the first sample foh holds its value.  bandlimited wants a uniform sampling interval; its largest error on
    white noise limited to 30, 66, 80 % of half the sampling rate is 4e-5, 5e-5, 2e-4 of the rms, and up to 2e-3 in the
    three intervals beside the record's ends.

    Raises ModelError for an unknown hold and for a drive that is not a finite number somewhere.
    """
    u = np.asarray(u, dtype=float)
    if hold not in get_args(Hold):
        raise ModelError(f"no hold {hold!r}; known: {', '.join(get_args(Hold))}")
    missing = np.flatnonzero(~np.all(np.isfinite(u), axis=1))
    if len(missing):
        raise ModelError(f"row {missing[0]} of the drive is not a number; the flow needs the drive of every interval")
    if hold == "zoh":
        return u[:, :, None].copy()
    if hold == "foh":
        before = np.concatenate([u[:1], u[:-1]])
        return np.stack([before, u - before], axis=2)
    return np.stack([_bandlimited(column) for column in u.T], axis=1)


def _bandlimited(u: Array) -> Array:
    """Hermite pieces (n, 8) through the samples u (n,) with the derivatives of the band-limited signal through them."""
    margin = min(_MARGIN, len(u))
    mean = float(np.mean(u))
    ahead, behind = _continuation(u - mean, margin), _continuation(u[::-1] - mean, margin)
    extended = np.concatenate([behind[::-1], u - mean, ahead])
    spectrum = np.fft.rfft(extended)
    frequency = 2j * np.pi * np.fft.rfftfreq(len(extended))
    if len(extended) % 2 == 0:
        frequency[-1] = 0.0  # the line at half the sampling rate has no phase, so no derivative
    orders = np.arange(_DERIVATIVES)[:, None]
    derivatives = np.fft.irfft(spectrum * frequency**orders, len(extended))[:, margin - 1 : margin + len(u)]
    derivatives[0] = extended[margin - 1 : margin + len(u)]
    ends = np.concatenate([derivatives[:, :-1], derivatives[:, 1:]])
    pieces = np.linalg.solve(_derivatives_at_ends(), ends).T
    pieces[:, 0] += mean
    return np.ascontiguousarray(pieces)


def _derivatives_at_ends() -> Array:
    """Derivatives 0, 1, 2, … at τ = 0, then at τ = 1, of the monomials τⁿ: (8, 8)."""
    size = 2 * _DERIVATIVES
    matrix = np.zeros((size, size))
    for order in range(_DERIVATIVES):
        matrix[order, order] = factorial(order)
        for n in range(order, size):
            matrix[_DERIVATIVES + order, n] = factorial(n) / factorial(n - order)
    return matrix


def _continuation(u: Array, samples: int) -> Array:
    """`samples` more of u (n,) by linear prediction, faded out.

    A record is not periodic: without a continuation the step from its end to its beginning rings through all
    derivatives.
    """
    order = min(_PREDICTOR, len(u) // 3)
    predictor = _burg(u, order)
    from scipy.signal import lfilter, lfiltic  # scipy.signal takes half a second to load

    memory = lfiltic([1.0], predictor, u[: -order - 1 : -1])
    further, _ = lfilter([1.0], predictor, np.zeros(samples), zi=memory)
    fade = 0.5 + 0.5 * np.cos(np.pi * (np.arange(samples) + 0.5) / samples)
    return np.asarray(further * fade)


def _burg(u: Array, order: int) -> Array:
    """Prediction error filter (order + 1,) of u by Burg's method, which is stable for any u (J. P. Burg, 1975)."""
    a = np.ones(1)
    forward, backward = u[1:], u[:-1]
    for _ in range(order):
        power = forward @ forward + backward @ backward
        if power == 0.0:
            break
        reflection = -2.0 * (forward @ backward) / power
        a = np.append(a, 0.0)
        a = a + reflection * a[::-1]
        forward, backward = (forward + reflection * backward)[1:], (backward + reflection * forward)[:-1]
    return a
