"""What a device of `alder` can have beyond equation (2): laws in C, and how large their coefficients are drawn.

Forces Fx, Fy are per unit mass [m/s²], sensed displacements X, Y in m, all in SI. Those of the catalogue are the laws
of docs/reference/effects.md, with |v| itself where that page rounds it. Names that a law may use: x, y [m], vx, vy
[m/s], ux, uy [m/s²] (the drive that acts), t [s], W [rad/s], A [m], w0 [rad/s], warm [K]. A force has s[4…13] as well,
further states, with their derivatives o[4…13], and lastx, lasty, the drive at the end of the interval before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

COEFFICIENTS = 6  # places of an effect in the kernel


class Scales(Protocol):
    """Sizes of a device: stiffness per mass k [1/s²], w0 [rad/s], amplitude A and its largest, peak [m], step Ts [s],
    largest drive U and its rms u [m/s²]."""

    k: float
    w0: float
    A: float
    peak: float
    Ts: float
    U: float
    u: float


@dataclass(frozen=True)
class Coefficient:
    """A number of a law: what it is at size 1, and how it follows the size."""

    symbol: str
    scale: Callable[[Scales], float]
    law: str = "+"  # + ± proportional to the size; fixed; one: 1; inverse: over the size


@dataclass(frozen=True)
class Effect:
    """An effect: its key, words, coefficients (at most six) and laws. `catalogue`: its key is a name of effects.md."""

    key: str
    words: str
    coefficients: tuple[Coefficient, ...]
    force: str = ""
    sense: str = ""
    group: str = "mechanics"
    catalogue: bool = True
    slow: bool = False  # needs a device that warms up within a record


def each(names: str, scale: Callable[[Scales], float], law: str = "+") -> tuple[Coefficient, ...]:
    """The same scale for the coefficients named."""
    return tuple(Coefficient(name, scale, law) for name in names.split())


FRICTION = (*each("fx fy", lambda d: 0.01 * d.k * d.A), Coefficient("v0", lambda d: 0.01 * d.A * d.w0, "fixed"))
LINE = "const double C = cos(omega * t), S = sin(omega * t);"

CATALOGUE = (
    Effect(
        "cubic_stiffness",
        "cubic stiffness of each axis",
        each("k3x k3y", lambda d: 0.08 * d.k / d.A**2, "±"),
        "Fx -= k3x * x * x * x; Fy -= k3y * y * y * y;",
    ),
    Effect(
        "cubic_isotropic",
        "cubic stiffness along the radius",
        each("k3", lambda d: 0.08 * d.k / d.A**2, "±"),
        "const double r2 = x * x + y * y; Fx -= k3 * x * r2; Fy -= k3 * y * r2;",
    ),
    Effect(
        "quadratic_stiffness",
        "spring that is stiffer one way than the other",
        each("k2x k2y", lambda d: 0.08 * d.k / d.A, "±"),
        "Fx -= k2x * x * x; Fy -= k2y * y * y;",
    ),
    Effect(
        "quintic_stiffness",
        "stiffness of the fifth order of each axis",
        each("k5x k5y", lambda d: 0.08 * d.k / d.A**4, "±"),
        "Fx -= k5x * pow(x, 5); Fy -= k5y * pow(y, 5);",
    ),
    Effect(
        "quintic_isotropic",
        "stiffness of the fifth order along the radius",
        each("k5r", lambda d: 0.08 * d.k / d.A**4, "±"),
        "const double r2 = x * x + y * y; Fx -= k5r * x * r2 * r2; Fy -= k5r * y * r2 * r2;",
    ),
    Effect(
        "nonreciprocal_stiffness",
        "antisymmetric stiffness",
        each("kn", lambda d: 0.02 * d.k, "±"),
        "Fx -= kn * y; Fy += kn * x;",
    ),
    Effect(
        "nonlinear_damping",
        "damping that grows with the displacement, per axis",
        each("d3x d3y", lambda d: 0.03 * d.w0 / d.A**2),
        "Fx -= d3x * vx * x * x; Fy -= d3y * vy * y * y;",
    ),
    Effect(
        "dry_friction",
        "Coulomb friction of each axis, rounded at v0",
        FRICTION,
        "Fx -= fx * tanh(vx / v0); Fy -= fy * tanh(vy / v0);",
    ),
    Effect(
        "dry_friction_asymmetric",
        "friction that is larger one way than the other, its half difference",
        (*each("fax fay", lambda d: 0.03 * d.k * d.A, "±"), FRICTION[2]),
        "Fx -= fax * pow(tanh(vx / v0), 2); Fy -= fay * pow(tanh(vy / v0), 2);",
    ),
    Effect(
        "damping_asymmetric",
        "damping that is larger one way than the other",
        each("dax day", lambda d: 0.05 * d.w0, "±"),
        "Fx -= dax * fabs(vx); Fy -= day * fabs(vy);",
    ),
    Effect(
        "drag",
        "drag with the square of the speed, per axis",
        each("dqx dqy", lambda d: 0.02 / d.A),
        "Fx -= dqx * vx * fabs(vx); Fy -= dqy * vy * fabs(vy);",
    ),
    Effect(
        "cubic_damping",
        "damping with the cube of the speed, per axis",
        each("dcx dcy", lambda d: 0.02 / (d.w0 * d.A**2)),
        "Fx -= dcx * vx * vx * vx; Fy -= dcy * vy * vy * vy;",
    ),
    Effect(
        "drag_radial",
        "drag against the motion in the plane, tried on request",
        each("dqr", lambda d: 0.02 / d.A),
        "const double v = sqrt(vx * vx + vy * vy); Fx -= dqr * v * vx; Fy -= dqr * v * vy;",
    ),
    Effect(
        "nonlinear_damping_radial",
        "damping that grows with the distance from the centre, tried on request",
        each("d3r", lambda d: 0.03 * d.w0 / d.A**2),
        "const double r2 = x * x + y * y; Fx -= d3r * r2 * vx; Fy -= d3r * r2 * vy;",
    ),
    Effect(
        "base_vibration",
        "a base that shakes at one frequency",
        (
            *each("bcx bsx bcy bsy", lambda d: 0.02 * d.k * d.A, "±"),
            Coefficient("omega", lambda d: 0.9 * d.w0, "fixed"),
        ),
        LINE + "Fx += bcx * C + bsx * S; Fy += bcy * C + bsy * S;",
    ),
    Effect(
        "temperature_stiffness",
        "stiffness that moves with the measured temperature",
        each("ktx kty ktxy", lambda d: 2e-3 * d.k, "±"),
        "Fx -= warm * (ktx * x + ktxy * y); Fy -= warm * (ktxy * x + kty * y);",
        slow=True,
    ),
    Effect(
        "drive_gain",
        "gain of each drive off",
        each("hx hy", lambda d: 0.3, "±"),
        "Fx += hx * ux; Fy += hy * uy;",
        group="drive",
    ),
    Effect(
        "drive_misalignment",
        "each drive pushes the other axis too",
        each("mx my", lambda d: 0.2, "±"),
        "Fx += mx * uy; Fy += my * ux;",
        group="drive",
    ),
    Effect("drive_delay", "drives late", each("tux tuy", lambda d: 0.9 * d.Ts), group="drive"),
    Effect(
        "electrostatic_drive",
        "force with the square of the drive",
        each("qx qy", lambda d: 0.5 / d.U, "±"),
        "Fx += qx * ux * ux; Fy += qy * uy * uy;",
        group="drive",
    ),
    Effect(
        "drive_saturation",
        "drive amplifiers that stop short",
        (Coefficient("limit", lambda d: 0.4 * d.U, "inverse"), *each("sx sy", lambda d: 1.0, "one")),
        "Fx += sx * (clamp(ux, limit) - ux); Fy += sy * (clamp(uy, limit) - uy);",
        group="drive",
    ),
    Effect(
        "drive_dead_band",
        "small drives do nothing",
        (Coefficient("band", lambda d: 0.7 * d.u), *each("zx zy", lambda d: 1.0, "one")),
        "Fx -= zx * clamp(ux, band); Fy -= zy * clamp(uy, band);",
        group="drive",
    ),
    Effect(
        "drive_feedthrough",
        "sense electrodes that see the drive",
        each("fdx fdy", lambda d: 1.5 / d.k, "±"),
        sense="X += fdx * ux; Y += fdy * uy;",
        group="drive",
    ),
    Effect(
        "parasitic_mode",
        "another mode, driven and seen",
        (
            *each("rx ry", lambda d: 0.5, "±"),
            Coefficient("omega", lambda d: 2.6 * d.w0, "fixed"),
            Coefficient("zeta", lambda d: 0.01, "fixed"),
        ),
        """o[8] = s[9]; o[9] = ux - 2 * zeta * omega * s[9] - omega * omega * s[8];
        o[10] = s[11]; o[11] = uy - 2 * zeta * omega * s[11] - omega * omega * s[10];""",
        "X += rx * sx[8]; Y += ry * sy[10];",
        "drive",
    ),
    Effect("sense_gain", "sense gain of y off", each("gy", lambda d: 0.2, "±"), sense="Y += gy * y;", group="sense"),
    Effect(
        "sense_cross_coupling",
        "each channel senses some of the other axis",
        each("ex ey", lambda d: 0.1, "±"),
        sense="X += ex * sx[2]; Y += ey * sy[0];",
        group="sense",
    ),
    Effect(
        "sense_quadratic",
        "quadratic sense characteristic",
        each("a2x a2y", lambda d: 0.1 / d.A, "±"),
        sense="X += a2x * x * x; Y += a2y * y * y;",
        group="sense",
    ),
    Effect(
        "sense_cubic",
        "cubic sense characteristic",
        each("a3x a3y", lambda d: 0.1 / d.A**2, "±"),
        sense="X += a3x * x * x * x; Y += a3y * y * y * y;",
        group="sense",
    ),
    Effect("sense_delay", "sense channels late", each("tsx tsy", lambda d: 0.9 * d.Ts), group="sense"),
    Effect(
        "sense_low_pass",
        "a low-pass pole in each channel",
        each("tlx tly", lambda d: 0.3 / d.w0),
        "o[4] = (x - s[4]) / tlx; o[5] = (y - s[5]) / tly;",
        "X += sx[4] - x; Y += sy[5] - y;",
        "sense",
    ),
    Effect(
        "sense_high_pass",
        "charge amplifiers that leak",
        each("leak_x leak_y", lambda d: 0.1 * d.w0),
        "o[6] = x - leak_x * s[6]; o[7] = y - leak_y * s[7];",
        "X -= leak_x * sx[6]; Y -= leak_y * sy[7];",
        "sense",
    ),
    Effect(
        "interference",
        "a line of another source in both channels, t that of the record",
        (
            *each("lcx lsx lcy lsy", lambda d: 0.1 * d.A, "±"),
            Coefficient("omega", lambda d: 2.2 * d.w0, "fixed"),
        ),
        sense=LINE + "X += lcx * C + lsx * S; Y += lcy * C + lsy * S;",
        group="sense",
    ),
)

OUTSIDE = (
    Effect(
        "self_heating",
        "stiffness -k (1 - c h) softened by a warmth h' = (e - h)/tau, e the energy over that at A",
        (Coefficient("c", lambda d: 0.01), Coefficient("tau", lambda d: 4000 / d.w0, "fixed")),
        "o[12] = ((x * x + y * y + (vx * vx + vy * vy) / (w0 * w0)) / (A * A) - s[12]) / tau;"
        "Fx += c * w0 * w0 * s[12] * x; Fy += c * w0 * w0 * s[12] * y;",
        catalogue=False,
    ),
    Effect(
        "gas_memory",
        "gas film whose stiffness lags the square of the displacement: z' = (r^2/A^2 - z)/tau, force -c z (x, y)",
        (Coefficient("c", lambda d: 0.1 * d.k), Coefficient("tau", lambda d: 20 / d.w0, "fixed")),
        "o[12] = ((x * x + y * y) / (A * A) - s[12]) / tau; Fx -= c * s[12] * x; Fy -= c * s[12] * y;",
        catalogue=False,
    ),
    Effect(
        "quartic_cross",
        "potential c x^3 y: forces -3 c x^2 y, -c x^3",
        each("c", lambda d: 0.05 * d.k / d.A**2, "±"),
        "Fx -= 3 * c * x * x * y; Fy -= c * x * x * x;",
        catalogue=False,
    ),
    Effect(
        "pumped_stiffness",
        "stiffness of x modulated by a foreign tone: -c sin(omega t) x",
        (Coefficient("c", lambda d: 0.05 * d.k), Coefficient("omega", lambda d: 0.2 * d.w0, "fixed")),
        "Fx -= c * sin(omega * t) * x;",
        catalogue=False,
    ),
    Effect(
        "hertz_contact",
        "a bump on one side of x: -c (x - g)^1.5 beyond g",
        (
            Coefficient("c", lambda d: 1.0 * d.k / d.A**0.5),
            Coefficient("g", lambda d: 0.95 * d.peak, "fixed"),
        ),
        "if (x > g) Fx -= c * pow(x - g, 1.5);",
        catalogue=False,
    ),
    Effect(
        "soft_amplifier",
        "drive amplifiers that compress: L tanh(u/L) in place of u",
        (Coefficient("L", lambda d: 0.3 * d.U, "inverse"),),
        "Fx += L * tanh(ux / L) - ux; Fy += L * tanh(uy / L) - uy;",
        group="drive",
        catalogue=False,
    ),
    Effect(
        "slew",
        "drive amplifiers whose output changes by no more than slew a second",
        (Coefficient("slew", lambda d: 0.3 * d.U / d.Ts, "inverse"),),
        "Fx += lastx + clamp(ux - lastx, slew * dt) - ux; Fy += lasty + clamp(uy - lasty, slew * dt) - uy;",
        group="drive",
        catalogue=False,
    ),
    Effect(
        "gain_ripple",
        "sense gain of both channels that follows a supply's ripple: 1 + c sin(omega t)",
        (Coefficient("c", lambda d: 0.05), Coefficient("omega", lambda d: 0.02 * d.w0, "fixed")),
        sense="X += c * sin(omega * t) * x; Y += c * sin(omega * t) * y;",
        group="sense",
        catalogue=False,
    ),
    Effect(
        "charging",
        "a dielectric that charges with the square of the motion: q' = (x^2/A^2 - q)/tau, c q added to what is sensed",
        (Coefficient("c", lambda d: 0.5 * d.A), Coefficient("tau", lambda d: 600 / d.w0, "fixed")),
        "o[12] = (x * x / (A * A) - s[12]) / tau; o[13] = (y * y / (A * A) - s[13]) / tau;",
        "X += c * sx[12]; Y += c * sy[13];",
        "sense",
        catalogue=False,
    ),
)

EFFECTS = {effect.key: effect for effect in CATALOGUE + OUTSIDE}
SINGLE_TONE = (  # what shows at constant amplitude and rate, without dither
    *("cubic_stiffness", "quadratic_stiffness", "quintic_stiffness", "dry_friction", "dry_friction_asymmetric"),
    *("sense_quadratic", "sense_cubic", "interference", "base_vibration", "electrostatic_drive"),
)


def laws(kind: str) -> str:
    """C text of all laws of `kind`, force or sense, each behind its switch."""
    blocks = []
    for i, effect in enumerate(EFFECTS.values()):
        text = effect.force if kind == "force" else effect.sense
        if text:
            numbers = "".join(
                f"const double {c.symbol} = q->coefficients[{i} * COEFFICIENTS + {j}]; (void){c.symbol};\n"
                for j, c in enumerate(effect.coefficients)
            )
            blocks.append(f"if (q->on[{i}]) {{\n{numbers}{text}\n}}")
    return "\n".join(blocks)


def coefficients(effect: Effect, device: Scales, size: float, parts: Sequence[float]) -> dict[str, float]:
    """Coefficients at `size` (0 to 1), each with its part drawn from (0.4, 1)."""
    values = {}
    for c, part in zip(effect.coefficients, parts, strict=False):
        scale = c.scale(device) * (1.0 if c.law == "one" else abs(part))
        factor = {"fixed": 1.0, "one": 1.0, "inverse": 1 / size}.get(c.law, size)
        values[c.symbol] = float(f"{math.copysign(1, part if c.law == '±' else 1) * scale * factor:.6g}")
    return values
