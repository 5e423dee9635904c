"""How far two estimates of one record are apart, as relative numbers that mean something for every quantity."""

import numpy as np

from estimator.observer import Estimates
from estimator.scaling import Array

ANGLES = (
    "angle",
    "angle_deviation",
    "angle_forced",
    "angle_pattern",
    "angle_plain",
    "angle_rate_integral",
    "energy_ratio",
    "quadrature_ratio",
)


def disagreement(one: Estimates, other: Estimates) -> dict[str, float]:
    """Largest relative difference over the record, by name; 0 is equality to the last bit.

    A state or constant: relative to its largest magnitude in the record or, where it never left the neighbourhood of
    zero, to its smallest standard deviation, since a difference far below what is known of a value is none.
    "deviation": each standard deviation relative to itself.  "innovation": relative to itself or, where it is smaller,
    to its predicted deviation.  Angles: in radians; ratios: as they are, both being of order one.
    """
    apart = np.max(np.abs(one.state - other.state), axis=0)
    known = np.min(other.deviation, axis=0)
    scale = np.maximum(np.max(np.abs(other.state), axis=0), known)
    found = dict(zip(one.names, (float(x) for x in _ratio(apart, scale)), strict=True))
    found["deviation"] = _largest(one.deviation - other.deviation, other.deviation)
    sd = other.innovation_deviation
    found["innovation"] = _largest(one.innovation - other.innovation, np.maximum(sd, np.abs(other.innovation)))
    found["innovation_deviation"] = _largest(one.innovation_deviation - sd, sd)
    for name in ANGLES:
        found[name] = _largest(getattr(one, name) - getattr(other, name), np.ones(1))
    return found


def _ratio(apart: Array, scale: Array) -> Array:
    """|apart|/scale; 0 where both are zero (a constant that a variant does not estimate), not finite where only
    scale is.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((apart == 0.0) & (scale == 0.0), 0.0, np.abs(apart) / scale)


def _largest(apart: Array, scale: Array) -> float:
    return float(np.max(_ratio(apart, scale)))
