"""What hidden effects do between the motion and the code: combs, amplifiers, converter."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.compiled import compiled
from device_emulator.effects.catalogue import Kind


@compiled
def displacement(effects: NDArray[Any], motion: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """What the two sense combs read of the motion [x, ẋ, y, ẏ, …], in the same order and units."""
    x, vx, y, vy = motion[0], motion[1], motion[2], motion[3]
    px, vpx, py, vpy = x, vx, y, vy
    for effect in effects:
        kind, c = effect.kind, effect.c
        if kind == Kind.SENSE_GAIN:
            px += c[0] * x
            vpx += c[0] * vx
            py += c[1] * y
            vpy += c[1] * vy
        elif kind == Kind.SENSE_CROSS_COUPLING:
            px += c[0] * y
            vpx += c[0] * vy
            py += c[1] * x
            vpy += c[1] * vx
        elif kind == Kind.SENSE_QUADRATIC:
            px += c[0] * x * x
            vpx += 2.0 * c[0] * x * vx
            py += c[1] * y * y
            vpy += 2.0 * c[1] * y * vy
        elif kind == Kind.SENSE_CUBIC:
            px += c[0] * x * x * x
            vpx += 3.0 * c[0] * x * x * vx
            py += c[1] * y * y * y
            vpy += 3.0 * c[1] * y * y * vy
        elif kind == Kind.SENSE_POLARITY:
            if c[0] == 1.0:
                px, vpx = -px, -vpx
            if c[1] == 1.0:
                py, vpy = -py, -vpy
        elif kind == Kind.PARASITIC_MODE:
            at = effect.at
            px += motion[at]
            vpx += motion[at + 1]
            py += motion[at + 2]
            vpy += motion[at + 3]
    return px, vpx, py, vpy


@compiled
def voltage(
    effects: NDArray[Any], t_s: float, warmer_K: float, ux: float, uy: float, motion: NDArray[np.float64]
) -> tuple[float, float]:
    """Voltage that the effects add in the amplifiers, under the force held up to the sampling instant."""
    vx = 0.0
    vy = 0.0
    for effect in effects:
        kind, c = effect.kind, effect.c
        if kind == Kind.DRIVE_FEEDTHROUGH:
            vx += c[0] * ux
            vy += c[1] * uy
        elif kind == Kind.INTERFERENCE:
            phase = 2.0 * math.pi * c[2] * t_s
            vx += c[0] * math.sin(phase + c[3])
            vy += c[1] * math.sin(phase + c[4])
        elif kind == Kind.THERMAL_OFFSET:
            vx += c[0] * warmer_K
            vy += c[1] * warmer_K
        elif kind == Kind.TELEGRAPH_OFFSET:
            vx += c[0] * motion[effect.at]
            vy += c[1] * motion[effect.at + 1]
    return vx, vy


@compiled
def amplified(effects: NDArray[Any], axis: int, volts: float) -> float:
    """What the amplifier of an axis puts out when `volts` are due."""
    for effect in effects:
        if effect.kind == Kind.SENSE_SATURATION:
            volts = min(max(volts, -effect.c[axis]), effect.c[axis])
    return volts


@compiled
def shown(effects: NDArray[Any], code: int) -> int:
    """The code that a converter with flaws shows for `code`."""
    for effect in effects:
        if effect.kind == Kind.MISSING_CODES:
            beyond = code % int(effect.c[0])
            if beyond < effect.c[1]:
                code -= beyond
    return code


@compiled
def flip(effects: NDArray[Any], seed: int, tick: int, ts_s: float, motion: NDArray[np.float64]) -> None:
    """Throw the dice of random telegraphs for one sample; they start at 1.

    Whether one flips is hashed from seed and tick (splitmix64), so that they leave the noise as it is.
    """
    for effect in effects:
        if effect.kind == Kind.TELEGRAPH_OFFSET:
            for axis in range(2):
                if tick == 0:
                    motion[effect.at + axis] = 1.0
                elif _uniform(seed, 2 * tick + axis) < -0.5 * math.expm1(-2.0 * effect.c[2] * ts_s):
                    motion[effect.at + axis] *= -1.0


@compiled
def _uniform(seed: int, number: int) -> float:
    """A number in [0, 1) from a seed and a count (Steele, Lea & Flood, OOPSLA 2014)."""
    z = np.uint64(seed) + np.uint64(number) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * 2.0**-53
