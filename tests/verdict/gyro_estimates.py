"""Estimates made by hand: a board that turned at a constant rate, at 10 rows a second."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hil.records.estimates import Estimates

RATE, VIRTUAL, SECONDS, SETTLE_S, LENGTH_S = 0.5, 3.0, 8.0, 2.0, 10.0
KXY, DXX, DYY, DXY = 1.5e4, 1.4, 1.1, 0.06
SD = 1e-3


def estimates(header: Mapping[str, Any] | None = None, **columns: Any) -> Estimates:
    """From 0 to `LENGTH_S`, of which `SECONDS` are scored; `columns` in place of the usual ones, numbers or arrays."""
    tick = np.arange(round(10.0 * LENGTH_S) + 1)
    t = tick / 10.0
    angle = 7.0 + RATE * t
    usual = {
        "angle_rad": angle,
        "angle_u_rad": 1e-3 * t,
        "angle_sd_rad": SD,
        "angle_forced_rad": VIRTUAL * t,
        "angle_pattern_rad": angle,
        "angle_plain_rad": angle,
        "energy_ratio": 1.0,
        "quadrature_ratio": 0.0,
        "kxy_per_s2": KXY,
        "dxx_per_s": DXX,
        "dyy_per_s": DYY,
        "dxy_per_s": DXY,
    }
    filled = {name: np.broadcast_to(np.asarray(value, float), t.shape) for name, value in (usual | columns).items()}
    return Estimates({"tick": tick, **filled}, {"tick_rate_Hz": 10.0, "states": [], **(header or {})}, True)
