"""What hidden effects do between the motion and the code: combs, amplifiers, converter."""

import math
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.compiled import compiled
from device_emulator.effects.declaration import LINE, Coefficient, Declaration, given, limits, per_axis, switches


class SenseKind(IntEnum):
    """What acts between the motion and the code, in no order that matters."""

    SENSE_GAIN = 40
    SENSE_CROSS_COUPLING = 41
    SENSE_QUADRATIC = 42
    SENSE_CUBIC = 43
    SENSE_DELAY = 44
    PARASITIC_MODE = 45
    SENSE_POLARITY = 46
    DRIVE_FEEDTHROUGH = 60
    INTERFERENCE = 61
    TEMPERATURE_OFFSET = 62
    TELEGRAPH_OFFSET = 63
    SENSE_CLIPPING = 64
    MISSING_CODES = 65
    FREE_MODE = 66


_RINGING = tuple(Coefficient(name, "V") for name in ("cmx", "smx", "cmy", "smy"))

DECLARATIONS: dict[IntEnum, Declaration] = {
    SenseKind.SENSE_GAIN: Declaration("x -> (1 + gx) x, y -> (1 + gy) y", per_axis("g", "1")),
    SenseKind.SENSE_CROSS_COUPLING: Declaration(
        "x -> x + ex y, y -> y + ey x", (Coefficient("ex", "1"), Coefficient("ey", "1"))
    ),
    SenseKind.SENSE_QUADRATIC: Declaration("x -> x + a2x x^2, y -> y + a2y y^2", per_axis("a2", "1/m")),
    SenseKind.SENSE_CUBIC: Declaration("x -> x + a3x x^3, y -> y + a3y y^3", per_axis("a3", "1/m²")),
    SenseKind.SENSE_DELAY: Declaration("x(t - tau)", (Coefficient("tsx", "s"), Coefficient("tsy", "s"))),
    SenseKind.PARASITIC_MODE: Declaration(
        "x -> x + px, px'' + 2 zeta w px' + w^2 px = rx ux, w = 2 pi f; y likewise",
        (given("frequency", "Hz"), given("zeta", "1"), *per_axis("r", "1")),
        states=4,
    ),
    SenseKind.SENSE_POLARITY: Declaration(
        "x -> -x where px = 1, y -> -y where py = 1, after what stands before it", switches()
    ),
    SenseKind.DRIVE_FEEDTHROUGH: Declaration("V + gamma u", per_axis("gamma_", "V·s²/m")),
    SenseKind.INTERFERENCE: Declaration("V + a sin(2 pi f t + psi)", (*per_axis("a", "V"), *LINE)),
    SenseKind.TEMPERATURE_OFFSET: Declaration("V + tc (T - T0)", per_axis("tc_", "V/K")),
    SenseKind.TELEGRAPH_OFFSET: Declaration(
        "V + a s, s = 1 or -1, changing at random `rate` times a second",
        (*per_axis("a", "V"), given("rate", "1/s")),
        states=2,
    ),
    SenseKind.FREE_MODE: Declaration(
        "V + p, p'' + dm p' + (wm^2 + dm^2/4) p = 0 from p = cm, p' = wm sm - dm cm / 2 on; an axis each",
        (given("wm", "1/s"), Coefficient("dm", "1/s"), *_RINGING),
        states=4,
    ),
    SenseKind.SENSE_CLIPPING: Declaration(
        "V -> clip(V, -limit_x, limit_x), before noise and converter", limits("limit_", "V")
    ),
    SenseKind.MISSING_CODES: Declaration(
        "codes n every ... n every + width - 1 all read n every", (given("every", "1"), given("width", "1"))
    ),
}


@compiled
def displacement(effects: NDArray[Any], motion: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """What the two sense combs read of the motion [x, ẋ, y, ẏ, …], in the same order and units."""
    x, vx, y, vy = motion[0], motion[1], motion[2], motion[3]
    px, vpx, py, vpy = x, vx, y, vy
    for effect in effects:
        kind, c = effect.kind, effect.c
        if kind == SenseKind.SENSE_GAIN:
            px += c[0] * x
            vpx += c[0] * vx
            py += c[1] * y
            vpy += c[1] * vy
        elif kind == SenseKind.SENSE_CROSS_COUPLING:
            px += c[0] * y
            vpx += c[0] * vy
            py += c[1] * x
            vpy += c[1] * vx
        elif kind == SenseKind.SENSE_QUADRATIC:
            px += c[0] * x * x
            vpx += 2.0 * c[0] * x * vx
            py += c[1] * y * y
            vpy += 2.0 * c[1] * y * vy
        elif kind == SenseKind.SENSE_CUBIC:
            px += c[0] * x * x * x
            vpx += 3.0 * c[0] * x * x * vx
            py += c[1] * y * y * y
            vpy += 3.0 * c[1] * y * y * vy
        elif kind == SenseKind.SENSE_POLARITY:
            if c[0] == 1.0:
                px, vpx = -px, -vpx
            if c[1] == 1.0:
                py, vpy = -py, -vpy
        elif kind == SenseKind.PARASITIC_MODE:
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
        if kind == SenseKind.DRIVE_FEEDTHROUGH:
            vx += c[0] * ux
            vy += c[1] * uy
        elif kind == SenseKind.INTERFERENCE:
            phase = 2.0 * math.pi * c[2] * t_s
            vx += c[0] * math.sin(phase + c[3])
            vy += c[1] * math.sin(phase + c[4])
        elif kind == SenseKind.TEMPERATURE_OFFSET:
            vx += c[0] * warmer_K
            vy += c[1] * warmer_K
        elif kind == SenseKind.TELEGRAPH_OFFSET:
            vx += c[0] * motion[effect.at]
            vy += c[1] * motion[effect.at + 1]
        elif kind == SenseKind.FREE_MODE:
            vx += motion[effect.at]
            vy += motion[effect.at + 2]
    return vx, vy


@compiled
def amplified(effects: NDArray[Any], axis: int, volts: float) -> float:
    """What the amplifier of an axis puts out when `volts` are due."""
    for effect in effects:
        if effect.kind == SenseKind.SENSE_CLIPPING:
            volts = min(max(volts, -effect.c[axis]), effect.c[axis])
    return volts


@compiled
def shown(effects: NDArray[Any], code: int) -> int:
    """The code that a converter with flaws shows for `code`."""
    for effect in effects:
        if effect.kind == SenseKind.MISSING_CODES:
            beyond = code % int(effect.c[0])
            if beyond < effect.c[1]:
                code -= beyond
    return code


@compiled
def flip(effects: NDArray[Any], seed: int, tick: int, ts_s: float, motion: NDArray[np.float64]) -> None:
    """Throw the dice of random telegraphs for one sample; they start at 1, modes that ring where they are told to.

    Whether one flips is hashed from seed and tick (splitmix64), so that they leave the noise as it is.
    """
    for effect in effects:
        if effect.kind == SenseKind.TELEGRAPH_OFFSET:
            for axis in range(2):
                if tick == 0:
                    motion[effect.at + axis] = 1.0
                elif _uniform(seed, 2 * tick + axis) < -0.5 * math.expm1(-2.0 * effect.c[2] * ts_s):
                    motion[effect.at + axis] *= -1.0
        elif effect.kind == SenseKind.FREE_MODE and tick == 0:
            for axis in range(2):
                beside, turned = effect.c[2 + 2 * axis], effect.c[3 + 2 * axis]
                motion[effect.at + 2 * axis] = beside
                motion[effect.at + 2 * axis + 1] = effect.c[0] * turned - 0.5 * effect.c[1] * beside


@compiled
def _uniform(seed: int, number: int) -> float:
    """A number in [0, 1) from a seed and a count (Steele, Lea & Flood, OOPSLA 2014)."""
    z = np.uint64(seed) + np.uint64(number) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * 2.0**-53
