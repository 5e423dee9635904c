"""The temperature of the board, from `[temperature]`: it warms up, and swings. The wire does not tell it."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.section import Positive, Section

TEMPERATURE = np.dtype(
    [("warm_up_K", "f8"), ("time_constant_s", "f8"), ("swing_K", "f8"), ("frequency_rad_s", "f8")], align=True
)


class Temperature(Section):
    """`[temperature]`: start_C + warm_up_K (1 - exp(-t / time_constant_s)) + swing_K sin(2π t / period_s)."""

    start_C: float = 25.0
    """temperature at tick 0"""
    warm_up_K: float = 0.0
    """rise after a long time"""
    time_constant_s: Positive = 1.0
    """of the rise"""
    swing_K: float = 0.0
    """amplitude of a swing"""
    period_s: Positive = 1.0
    """of the swing"""


def temperature_constants(temperature: Temperature) -> NDArray[Any]:
    """The profile as its kernel reads it, shape (1,) of dtype `TEMPERATURE`."""
    constants = np.zeros(1, TEMPERATURE)
    t = temperature
    constants[0] = t.warm_up_K, t.time_constant_s, t.swing_K, 2.0 * math.pi / t.period_s
    return constants
