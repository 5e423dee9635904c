"""What a θ means, with uncertainties: constants in SI, resonances, the axes of stiffness and of damping."""

from typing import NamedTuple

import numpy as np

from estimator.identify.fit import Fitted
from estimator.identify.model import NAMES, Array

_SHIFT = 1e-3  # of a standard deviation, over which a derivative is taken


class Constant(NamedTuple):
    """A number with its standard uncertainty (k = 1)."""

    name: str
    value: float
    u: float
    unit: str


_UNITS = {
    "kxx": "1/s²", "kyy": "1/s²", "kxy": "1/s²", "dxx": "1/s", "dyy": "1/s", "dxy": "1/s", "rate": "rad/s",
    "gain_x": "V/m", "gain_y": "V/m", "share_xy": "1", "share_yx": "1", "delay": "samples", "offset_x": "V",
    "offset_y": "V",
}  # fmt: skip
_DERIVED = {
    "resonance_1": "Hz", "resonance_2": "Hz", "split": "Hz", "azimuth": "rad", "decay_time_1": "s",
    "decay_time_2": "s", "q_1": "1", "q_2": "1", "damping_azimuth": "rad", "sense_gain_ratio": "1",
}  # fmt: skip


def factors(rate_Hz: float) -> Array:
    """SI of an entry of θ."""
    return np.array([rate_Hz**2] * 3 + [rate_Hz] * 4 + [rate_Hz**2] * 2 + [1.0] * 5)


def constants_of(found: Fitted, rate_Hz: float) -> dict[str, Constant]:
    """Of a fit, by name: entries of θ in SI, then what follows from them."""
    factor = factors(rate_Hz)
    value, covariance = found.theta * factor, found.covariance * np.outer(factor, factor)
    deviation = np.sqrt(np.diag(covariance))
    told = {
        name: Constant(name, float(v), float(u), _UNITS[name])
        for name, v, u in zip(NAMES, value, deviation, strict=True)
    }
    here = derived(value)
    slopes = []
    for k, u in enumerate(deviation):
        moved = value.copy()
        moved[k] += _SHIFT * u
        slopes.append((_nearest(derived(moved) - here)) / max(_SHIFT * u, 1e-300))
    spread = np.sqrt(np.maximum(np.diag(np.array(slopes).T @ covariance @ np.array(slopes)), 0.0))
    names = zip(_DERIVED.items(), here, spread, strict=True)
    return told | {name: Constant(name, float(v), float(u), unit) for (name, unit), v, u in names}


def derived(value: Array) -> Array:
    """(10,) in the order of the names above, of θ in SI.  The first axis is that of the higher resonance, and of the
    quicker decay; a Q is that of its resonance, of which the damping along its own axis tells.
    """
    squares, along = _axes(*value[:3])
    rates, damped = _axes(*value[3:6])
    hertz = np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)
    decay = 2.0 / np.where(rates > 0.0, rates, np.nan)
    aside = 0.5 * (rates[0] - rates[1]) * np.cos(2.0 * (along - damped)) * np.array([1.0, -1.0])
    q = 2.0 * np.pi * hertz / (0.5 * rates.sum() + aside)
    return np.array([
        *hertz, hertz[0] - hertz[1], along, *decay, *q, damped, value[8] / value[7],
    ])  # fmt: skip


def _axes(xx: float, yy: float, xy: float) -> tuple[Array, float]:
    """Principal values of a symmetric matrix, the larger first, and the direction of that one from x, 0 to π."""
    half, aside = 0.5 * (xx + yy), float(np.hypot(0.5 * (xx - yy), xy))
    return np.array([half + aside, half - aside]), float(0.5 * np.arctan2(2.0 * xy, xx - yy) % np.pi)


def _nearest(difference: Array) -> Array:
    """Of directions, which are the same half a turn on."""
    near = difference.copy()
    for at in (3, 8):
        near[at] = (near[at] + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    return near
