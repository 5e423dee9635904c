"""What hidden effects do to the mass and its suspension, and how their own states move."""

import math
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.compiled import compiled
from device_emulator.effects.declaration import LINE, Coefficient, Declaration, given, per_axis
from device_emulator.effects.sense import SenseKind


class ForceKind(IntEnum):
    """What acts on the mass, in no order that matters."""

    CUBIC_STIFFNESS = 1
    CUBIC_ISOTROPIC = 2
    QUADRATIC_STIFFNESS = 3
    NONLINEAR_DAMPING = 4
    DRY_FRICTION = 5
    CONSTANT_FORCE = 6
    BASE_VIBRATION = 7
    DRY_FRICTION_ASYMMETRIC = 8
    NONRECIPROCAL_STIFFNESS = 9
    ANGULAR_GAIN = 10
    TEMPERATURE_STIFFNESS = 11
    TEMPERATURE_DAMPING = 12
    BACKLASH = 13
    HYSTERETIC_STIFFNESS = 14
    STICK_SLIP_SUPPORT = 15
    PARAMETRIC_STIFFNESS = 16
    NONLINEAR_COUPLING = 17
    UNEQUAL_MASSES = 18
    STRIBECK_FRICTION = 81
    NONLINEAR_DAMPING_RADIAL = 82
    DRAG_RADIAL = 83
    CUBIC_DAMPING_RADIAL = 84
    DRY_FRICTION_RADIAL = 85
    DAMPING_ASYMMETRIC = 86
    DRAG = 87
    CUBIC_DAMPING = 88
    PLAY = 89
    QUINTIC_STIFFNESS = 90
    QUINTIC_ISOTROPIC = 91


_ALONG_THE_MOTION = (
    ForceKind.NONLINEAR_DAMPING_RADIAL,
    ForceKind.DRAG_RADIAL,
    ForceKind.CUBIC_DAMPING_RADIAL,
    ForceKind.DRY_FRICTION_RADIAL,
)

_FRICTION = (*per_axis("f", "m/s²"), given("v0", "m/s"))

DECLARATIONS: dict[IntEnum, Declaration] = {
    ForceKind.CUBIC_STIFFNESS: Declaration("-k3x x^3, -k3y y^3", per_axis("k3", "1/(m²·s²)")),
    ForceKind.CUBIC_ISOTROPIC: Declaration("-k3 r^2 (x, y)", (Coefficient("k3", "1/(m²·s²)"),)),
    ForceKind.QUINTIC_STIFFNESS: Declaration("-k5x x^5, -k5y y^5", per_axis("k5", "1/(m⁴·s²)")),
    ForceKind.QUINTIC_ISOTROPIC: Declaration("-k5r r^4 (x, y)", (Coefficient("k5r", "1/(m⁴·s²)"),)),
    ForceKind.QUADRATIC_STIFFNESS: Declaration("-k2x x^2, -k2y y^2", per_axis("k2", "1/(m·s²)")),
    ForceKind.NONLINEAR_DAMPING: Declaration("-d3x x^2 x', -d3y y^2 y'", per_axis("d3", "1/(m²·s)")),
    ForceKind.DRY_FRICTION: Declaration("-fx tanh(x'/v0), -fy tanh(y'/v0)", _FRICTION),
    ForceKind.STRIBECK_FRICTION: Declaration(
        "-stx tanh(x'/v0) exp(-(x'/vs)^2), -sty (...): what friction at rest has beside that of motion",
        (*per_axis("st", "m/s²"), given("v0", "m/s"), given("vs", "m/s")),
    ),
    ForceKind.NONLINEAR_DAMPING_RADIAL: Declaration("-d3r r^2 (x', y')", (Coefficient("d3r", "1/(m²·s)"),)),
    ForceKind.DRAG: Declaration("-dqx |x'| x', -dqy |y'| y'", per_axis("dq", "1/m")),
    ForceKind.DRAG_RADIAL: Declaration("-dqr |v| (x', y')", (Coefficient("dqr", "1/m"),)),
    ForceKind.CUBIC_DAMPING: Declaration("-dcx x'^3, -dcy y'^3", per_axis("dc", "s/m²")),
    ForceKind.CUBIC_DAMPING_RADIAL: Declaration("-dcr |v|^2 (x', y')", (Coefficient("dcr", "s/m²"),)),
    ForceKind.DAMPING_ASYMMETRIC: Declaration("-dax |x'|, -day |y'|", per_axis("da", "1/s")),
    ForceKind.DRY_FRICTION_RADIAL: Declaration(
        "-fr (x', y') / sqrt(|v|^2 + v0^2): against the motion, whatever its direction",
        (Coefficient("fr", "m/s²"), given("v0", "m/s")),
    ),
    ForceKind.CONSTANT_FORCE: Declaration("+ax, +ay", per_axis("a", "m/s²")),
    ForceKind.BASE_VIBRATION: Declaration("+ax sin(2 pi f t + psi_x), +ay sin(...)", (*per_axis("a", "m/s²"), *LINE)),
    ForceKind.DRY_FRICTION_ASYMMETRIC: Declaration(
        "-fx (T + ax T^2) with T = tanh(x'/v0), -fy (...): f (1 + a) forth, f (1 - a) back",
        (*_FRICTION, *per_axis("a", "1")),
    ),
    ForceKind.NONRECIPROCAL_STIFFNESS: Declaration("-kn y, +kn x", (Coefficient("kn", "1/s²"),)),
    ForceKind.ANGULAR_GAIN: Declaration(
        "Coriolis and Euler force times 1 + kappa: +kappa (2 W y' + W' y), -kappa (2 W x' + W' x)",
        (Coefficient("kappa", "1"),),
    ),
    ForceKind.TEMPERATURE_STIFFNESS: Declaration("K (1 + tc (T - T0))", (Coefficient("tc", "1/K"),)),
    ForceKind.TEMPERATURE_DAMPING: Declaration("D (1 + tc (T - T0))", (Coefficient("tc", "1/K"),)),
    ForceKind.BACKLASH: Declaration(
        "-kbx (x - clip(x, -gap, gap)), -kby (...): a spring with play",
        (*per_axis("kb", "1/s²"), given("gap", "m")),
    ),
    ForceKind.HYSTERETIC_STIFFNESS: Declaration(
        "-khx zx, zx' = x' - (|x'| zx + x' |zx|) / (2 reach); y likewise (Bouc and Wen, exponent 1)",
        (*per_axis("kh", "1/s²"), given("reach", "m")),
        states=2,
    ),
    ForceKind.PLAY: Declaration(
        "-kpx (x - zx), a spring to a foot that the mass takes along once it is half_width away: "
        "zx = max(x - half_width, min(x + half_width, zx)), from 0; y likewise",
        (*per_axis("kp", "1/s²"), given("half_width", "m")),
        states=4,
    ),
    ForceKind.STICK_SLIP_SUPPORT: Declaration(
        "the package, 1/ratio as heavy as the mass, rests on springs and friction (LuGre): -X'', "
        "X'' = ratio r - (2 pi f)^2 X - s z - sqrt(s) z', z' = X' - s |X'| z / g, "
        "g = Fc + (Fs - Fc) exp(-(X'/vs)^2), r = K x + D x' - u; Y likewise",
        (
            given("ratio", "1"),
            given("frequency", "Hz"),
            given("Fs", "m/s²"),
            given("Fc", "m/s²"),
            given("vs", "m/s"),
            given("s", "1/s²"),
        ),
        states=6,
    ),
    ForceKind.PARAMETRIC_STIFFNESS: Declaration(
        "K (1 + depth sin(2 pi f t + psi))",
        (Coefficient("depth", "1"), given("frequency", "Hz"), Coefficient("phase", "rad")),
    ),
    ForceKind.NONLINEAR_COUPLING: Declaration(
        "-3 c x^2 y, -c x^3: potential c x^3 y", (Coefficient("c", "1/(m²·s²)"),)
    ),
    ForceKind.UNEQUAL_MASSES: Declaration(
        "y moves 1 + m times the mass of x: all of y'' but W^2 y over 1 + m, Coriolis and Euler force being "
        "of the mass that both move",
        (Coefficient("m", "1", None, above=-1.0),),
    ),
}


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
        if kind == ForceKind.CUBIC_STIFFNESS:
            ax -= c[0] * x * x * x
            ay -= c[1] * y * y * y
        elif kind == ForceKind.CUBIC_ISOTROPIC:
            r2 = x * x + y * y
            ax -= c[0] * r2 * x
            ay -= c[0] * r2 * y
        elif kind == ForceKind.QUINTIC_STIFFNESS:
            ax -= c[0] * x * x * x * x * x
            ay -= c[1] * y * y * y * y * y
        elif kind == ForceKind.QUINTIC_ISOTROPIC:
            r2 = x * x + y * y
            ax -= c[0] * r2 * r2 * x
            ay -= c[0] * r2 * r2 * y
        elif kind == ForceKind.QUADRATIC_STIFFNESS:
            ax -= c[0] * x * x
            ay -= c[1] * y * y
        elif kind == ForceKind.NONLINEAR_DAMPING:
            ax -= c[0] * x * x * vx
            ay -= c[1] * y * y * vy
        elif kind == ForceKind.DRY_FRICTION or kind == ForceKind.DRY_FRICTION_ASYMMETRIC:
            tx, ty = math.tanh(vx / c[2]), math.tanh(vy / c[2])
            ax -= c[0] * (tx + c[3] * tx * tx)
            ay -= c[1] * (ty + c[4] * ty * ty)
        elif kind == ForceKind.STRIBECK_FRICTION:
            slipx, slipy = vx / c[3], vy / c[3]
            ax -= c[0] * math.tanh(vx / c[2]) * math.exp(-slipx * slipx)
            ay -= c[1] * math.tanh(vy / c[2]) * math.exp(-slipy * slipy)
        elif kind == ForceKind.DRAG:
            ax -= c[0] * abs(vx) * vx
            ay -= c[1] * abs(vy) * vy
        elif kind == ForceKind.CUBIC_DAMPING:
            ax -= c[0] * vx * vx * vx
            ay -= c[1] * vy * vy * vy
        elif kind == ForceKind.DAMPING_ASYMMETRIC:
            ax -= c[0] * abs(vx)
            ay -= c[1] * abs(vy)
        elif kind in _ALONG_THE_MOTION:
            loss = _loss(kind, c, x * x + y * y, math.sqrt(vx * vx + vy * vy))
            ax -= loss * vx
            ay -= loss * vy
        elif kind == ForceKind.CONSTANT_FORCE:
            ax += c[0]
            ay += c[1]
        elif kind == ForceKind.BASE_VIBRATION:
            phase = 2.0 * math.pi * c[2] * t_s
            ax += c[0] * math.sin(phase + c[3])
            ay += c[1] * math.sin(phase + c[4])
        elif kind == ForceKind.NONRECIPROCAL_STIFFNESS:
            ax -= c[0] * y
            ay += c[0] * x
        elif kind == ForceKind.ANGULAR_GAIN:
            ax += c[0] * (2.0 * rate_rad_s * vy + slope_rad_s2 * y)
            ay -= c[0] * (2.0 * rate_rad_s * vx + slope_rad_s2 * x)
        elif kind == ForceKind.TEMPERATURE_STIFFNESS or kind == ForceKind.PARAMETRIC_STIFFNESS:
            if kind == ForceKind.TEMPERATURE_STIFFNESS:
                more = c[0] * warmer_K
            else:
                more = c[0] * math.sin(2.0 * math.pi * c[1] * t_s + c[2])
            ax -= more * (plant.kxx * x + plant.kxy * y)
            ay -= more * (plant.kxy * x + plant.kyy * y)
        elif kind == ForceKind.TEMPERATURE_DAMPING:
            ax -= c[0] * warmer_K * (plant.dxx * vx + plant.dxy * vy)
            ay -= c[0] * warmer_K * (plant.dxy * vx + plant.dyy * vy)
        elif kind == ForceKind.BACKLASH:
            ax -= c[0] * (x - min(max(x, -c[2]), c[2]))
            ay -= c[1] * (y - min(max(y, -c[2]), c[2]))
        elif kind == ForceKind.HYSTERETIC_STIFFNESS:
            ax -= c[0] * s[at]
            ay -= c[1] * s[at + 1]
            ds[at] = vx - (abs(vx) * s[at] + vx * abs(s[at])) / (2.0 * c[2])
            ds[at + 1] = vy - (abs(vy) * s[at + 1] + vy * abs(s[at + 1])) / (2.0 * c[2])
        elif kind == ForceKind.PLAY:
            ax -= c[0] * (x - s[at])
            ay -= c[1] * (y - s[at + 2])
            ds[at] = vx if s[at + 1] != 0.0 else 0.0
            ds[at + 1] = 0.0
            ds[at + 2] = vy if s[at + 3] != 0.0 else 0.0
            ds[at + 3] = 0.0
        elif kind == ForceKind.STICK_SLIP_SUPPORT:
            rx = plant.kxx * x + plant.kxy * y + plant.dxx * vx + plant.dxy * vy - ux
            ry = plant.kxy * x + plant.kyy * y + plant.dxy * vx + plant.dyy * vy - uy
            ax -= _support(c, rx, s[at : at + 3], ds[at : at + 3])
            ay -= _support(c, ry, s[at + 3 : at + 6], ds[at + 3 : at + 6])
        elif kind == ForceKind.NONLINEAR_COUPLING:
            ax -= 3.0 * c[0] * x * x * y
            ay -= c[0] * x * x * x
        elif kind == ForceKind.UNEQUAL_MASSES:
            # ÿ (1 + m) = the force on y, so that what is added is what the heavier mass leaves of it.
            pushed = uy - plant.kxy * x - plant.kyy * y - plant.dxy * vx - plant.dyy * vy
            pushed -= 2.0 * rate_rad_s * vx + slope_rad_s2 * x
            ay += pushed * (1.0 / (1.0 + c[0]) - 1.0)
        elif kind == SenseKind.PARASITIC_MODE:
            w = 2.0 * math.pi * c[0]
            ds[at] = s[at + 1]
            ds[at + 1] = c[2] * ux - 2.0 * c[1] * w * s[at + 1] - w * w * s[at]
            ds[at + 2] = s[at + 3]
            ds[at + 3] = c[3] * uy - 2.0 * c[1] * w * s[at + 3] - w * w * s[at + 2]
        elif kind == SenseKind.FREE_MODE:
            for axis in range(2):
                own = at + 2 * axis
                ds[own] = s[own + 1]
                ds[own + 1] = -c[1] * s[own + 1] - (c[0] * c[0] + 0.25 * c[1] * c[1]) * s[own]
        elif kind == SenseKind.TELEGRAPH_OFFSET:
            ds[at] = 0.0
            ds[at + 1] = 0.0
    ds[1] += ax
    ds[3] += ay


@compiled
def _loss(kind: int, c: NDArray[np.float64], r2: float, speed: float) -> float:
    """Damping 1/s of a law in the plane, at the squared distance r2 from the centre and that speed."""
    if kind == ForceKind.NONLINEAR_DAMPING_RADIAL:
        rate: float = c[0] * r2
    elif kind == ForceKind.DRAG_RADIAL:
        rate = c[0] * speed
    elif kind == ForceKind.CUBIC_DAMPING_RADIAL:
        rate = c[0] * speed * speed
    else:
        rate = c[0] / math.hypot(speed, c[1])
    return rate


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
        if effect.kind == ForceKind.UNEQUAL_MASSES:
            share /= 1.0 + effect.c[0]
    return share


@compiled
def coriolis(effects: NDArray[Any]) -> float:
    """How strongly the mass feels the rate: 1 and what the effects add."""
    gain = 1.0
    for effect in effects:
        if effect.kind == ForceKind.ANGULAR_GAIN:
            gain += effect.c[0]
    return gain
