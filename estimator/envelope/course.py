"""The amplitude of a ring-down over time: the averaged equation, solved by quadrature.

Of λ = ln a the rate λ' = −g(λ), g = Σ cᵢ Kᵢ exp((pᵢ − 1) λ), depends on λ alone, so that the time at which λ is reached
is an integral, t = ∫ dλ/g from λ up to the start.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from estimator.errors import ModelError
from estimator.scaling import Array

_CELLS = 2048
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


class Power(NamedTuple):
    """A law: a' = −c `size` a^`degree`."""

    size: float
    degree: float


def level_at(time: Array, start: float, coefficients: Array, powers: Sequence[Power], lowest: float) -> Array:
    """λ(t) (n,) at `time` (n,), scaled and from 0 on, from λ = `start` on.

    coefficients (k,), one for each of `powers`; lowest: λ below which nothing is followed, where the amplitude then
    stays: a motion that friction ends has come to rest there.

    Raises ModelError where the amplitude does not fall to the end of `time`: such a motion is no ring-down.
    """
    if not (np.isfinite(start) and np.all(np.isfinite(coefficients)) and start > lowest):
        raise ModelError("the amplitude at the first sample is no number above the lowest that is followed")
    edges = np.linspace(start, lowest, _CELLS + 1)
    height = (start - lowest) / _CELLS
    inside = edges[:-1, None] - 0.5 * height * (1.0 + _NODES)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        rate, between = _rate(edges, coefficients, powers), _rate(inside, coefficients, powers)
        falls = (rate[1:] > 0.0) & np.all(between > 0.0, axis=1) & np.isfinite(rate[1:])
    count = int(np.argmin(falls)) if not falls.all() else _CELLS
    if not rate[0] > 0.0 or count == 0:
        raise ModelError("the amplitude does not fall; a ring-down loses energy")
    rate, edges = rate[: count + 1], edges[: count + 1]
    weights = 0.5 * height * _WEIGHTS
    reached = np.concatenate([[0.0], np.cumsum((1.0 / between[:count]) @ weights)])
    if reached[-1] < time[-1] and count < _CELLS:
        raise ModelError("the amplitude does not fall to the end of the record; a ring-down loses energy")
    moving = time <= reached[-1]
    level = np.full(len(time), edges[-1])
    level[moving] = CubicHermiteSpline(reached, edges, -rate)(time[moving])
    return level


def _rate(level: Array, coefficients: Array, powers: Sequence[Power]) -> Array:
    """g at λ (…)."""
    acting = zip(coefficients, powers, strict=True)
    return np.asarray(sum(c * one.size * np.exp((one.degree - 1.0) * level) for c, one in acting))
