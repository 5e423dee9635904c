"""What hidden effects do to the mass and its suspension, and how their own states move."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.compiled import compiled
from device_emulator.effects.catalogue import Kind


@compiled
def force(
    plant: Any,
    effects: NDArray[Any],
    t_s: float,
    warmer_K: float,
    rate_rad_s: float,
    slope_rad_s2: float,
    ux: float,
    uy: float,
    s: NDArray[np.float64],
    ds: NDArray[np.float64],
) -> None:
    """Add to ds, the derivative of s = [x, ẋ, y, ẏ, …], what the effects add, and enter that of their own states.

    warmer_K is the temperature above that of the start; ux, uy reach the mass.
    """
    x, vx, y, vy = s[0], s[1], s[2], s[3]
    ax = 0.0
    ay = 0.0
    for effect in effects:
        kind, c, at = effect.kind, effect.c, effect.at
        if kind == Kind.CUBIC_STIFFNESS:
            ax -= c[0] * x * x * x
            ay -= c[1] * y * y * y
        elif kind == Kind.ISOTROPIC_CUBIC_STIFFNESS:
            r2 = x * x + y * y
            ax -= c[0] * r2 * x
            ay -= c[0] * r2 * y
        elif kind == Kind.QUADRATIC_STIFFNESS:
            ax -= c[0] * x * x
            ay -= c[1] * y * y
        elif kind == Kind.NONLINEAR_DAMPING:
            ax -= c[0] * x * x * vx
            ay -= c[1] * y * y * vy
        elif kind == Kind.DRY_FRICTION or kind == Kind.ASYMMETRIC_FRICTION:
            tx, ty = math.tanh(vx / c[2]), math.tanh(vy / c[2])
            ax -= c[0] * (tx + c[3] * tx * tx)
            ay -= c[1] * (ty + c[4] * ty * ty)
        elif kind == Kind.CONSTANT_FORCE:
            ax += c[0]
            ay += c[1]
        elif kind == Kind.BASE_VIBRATION:
            phase = 2.0 * math.pi * c[2] * t_s
            ax += c[0] * math.sin(phase + c[3])
            ay += c[1] * math.sin(phase + c[4])
        elif kind == Kind.NONRECIPROCAL_STIFFNESS:
            ax -= c[0] * y
            ay += c[0] * x
        elif kind == Kind.ANGULAR_GAIN:
            ax += c[0] * (2.0 * rate_rad_s * vy + slope_rad_s2 * y)
            ay -= c[0] * (2.0 * rate_rad_s * vx + slope_rad_s2 * x)
        elif kind == Kind.THERMAL_STIFFNESS or kind == Kind.PARAMETRIC_STIFFNESS:
            if kind == Kind.THERMAL_STIFFNESS:
                more = c[0] * warmer_K
            else:
                more = c[0] * math.sin(2.0 * math.pi * c[1] * t_s + c[2])
            ax -= more * (plant.kxx * x + plant.kxy * y)
            ay -= more * (plant.kxy * x + plant.kyy * y)
        elif kind == Kind.THERMAL_DAMPING:
            ax -= c[0] * warmer_K * (plant.dxx * vx + plant.dxy * vy)
            ay -= c[0] * warmer_K * (plant.dxy * vx + plant.dyy * vy)
        elif kind == Kind.BACKLASH:
            ax -= c[0] * (x - min(max(x, -c[2]), c[2]))
            ay -= c[1] * (y - min(max(y, -c[2]), c[2]))
        elif kind == Kind.HYSTERETIC_STIFFNESS:
            ax -= c[0] * s[at]
            ay -= c[1] * s[at + 1]
            ds[at] = vx - (abs(vx) * s[at] + vx * abs(s[at])) / (2.0 * c[2])
            ds[at + 1] = vy - (abs(vy) * s[at + 1] + vy * abs(s[at + 1])) / (2.0 * c[2])
        elif kind == Kind.STICK_SLIP_SUPPORT:
            rx = plant.kxx * x + plant.kxy * y + plant.dxx * vx + plant.dxy * vy - ux
            ry = plant.kxy * x + plant.kyy * y + plant.dxy * vx + plant.dyy * vy - uy
            ax -= _support(c, rx, s[at : at + 3], ds[at : at + 3])
            ay -= _support(c, ry, s[at + 3 : at + 6], ds[at + 3 : at + 6])
        elif kind == Kind.NONLINEAR_COUPLING:
            ax -= 3.0 * c[0] * x * x * y
            ay -= c[0] * x * x * x
        elif kind == Kind.UNEQUAL_MASSES:
            # ÿ (1 + m) = the force on y, so that what is added is what the heavier mass leaves of it.
            pushed = uy - plant.kxy * x - plant.kyy * y - plant.dxy * vx - plant.dyy * vy
            pushed -= 2.0 * rate_rad_s * vx + slope_rad_s2 * x
            ay += pushed * (1.0 / (1.0 + c[0]) - 1.0)
        elif kind == Kind.PARASITIC_MODE:
            w = 2.0 * math.pi * c[0]
            ds[at] = s[at + 1]
            ds[at + 1] = c[2] * ux - 2.0 * c[1] * w * s[at + 1] - w * w * s[at]
            ds[at + 2] = s[at + 3]
            ds[at + 3] = c[3] * uy - 2.0 * c[1] * w * s[at + 3] - w * w * s[at + 2]
        elif kind == Kind.TELEGRAPH_OFFSET:
            ds[at] = 0.0
            ds[at + 1] = 0.0
    ds[1] += ax
    ds[3] += ay


@compiled
def _support(c: NDArray[np.float64], reaction: float, s: NDArray[np.float64], ds: NDArray[np.float64]) -> float:
    """Acceleration of the package along one axis; s, ds: its displacement, velocity and bristle, (3,).

    Friction after Canudas de Wit, Olsson, Åström & Lischinsky, IEEE Trans. Autom. Control 40(3), 1995. Bristles bend
    over Fc/s; slip that covers more than that in one sub-step is beyond the integrator.
    """
    ratio, frequency, static, coulomb, stribeck, bristle = c[0], c[1], c[2], c[3], c[4], c[5]
    v, z = s[1], s[2]
    slip = v / stribeck
    g = coulomb + (static - coulomb) * math.exp(-slip * slip)
    dz = v - bristle * abs(v) * z / g
    w = 2.0 * math.pi * frequency
    a: float = ratio * reaction - w * w * s[0] - bristle * z - math.sqrt(bristle) * dz
    ds[0] = v
    ds[1] = a
    ds[2] = dz
    return a


@compiled
def lightness(effects: NDArray[Any]) -> float:
    """What y is accelerated by a force per unit mass of x: 1 where both axes move one mass."""
    share = 1.0
    for effect in effects:
        if effect.kind == Kind.UNEQUAL_MASSES:
            share /= 1.0 + effect.c[0]
    return share


@compiled
def coriolis(effects: NDArray[Any]) -> float:
    """How strongly the mass feels the rate: 1 and what the effects add."""
    gain = 1.0
    for effect in effects:
        if effect.kind == Kind.ANGULAR_GAIN:
            gain += effect.c[0]
    return gain
