"""Hidden effects: what the board has and its data sheet does not declare, by name, from `[[effect]]` tables.

To add one: a `Kind`, its entry in `DECLARATIONS`, and its lines in the function of the place where it acts:
`force` (acceleration of the mass), `drive` (force that reaches the mass), `displacement` (what the combs
read) or `voltage` (what the converter sees). Coefficients are SI and per unit mass.
"""

import math
from collections.abc import Iterable
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from device_emulator.compiled import compiled
from device_emulator.section import did_you_mean

MAX_COEFFICIENTS = 6
EFFECT = np.dtype([("kind", "i8"), ("c", "f8", (MAX_COEFFICIENTS,))], align=True)


class Kind(IntEnum):
    """The effects, in no order that matters."""

    CUBIC_STIFFNESS = 1
    ISOTROPIC_CUBIC_STIFFNESS = 2
    QUADRATIC_STIFFNESS = 3
    NONLINEAR_DAMPING = 4
    DRY_FRICTION = 5
    CONSTANT_FORCE = 6
    BASE_VIBRATION = 7
    DRIVE_GAIN = 20
    DRIVE_MISALIGNMENT = 21
    DRIVE_DELAY = 22
    SENSE_GAIN = 40
    SENSE_CROSS_COUPLING = 41
    SENSE_QUADRATIC = 42
    SENSE_CUBIC = 43
    SENSE_DELAY = 44
    DRIVE_FEEDTHROUGH = 60
    INTERFERENCE = 61


class Coefficient(NamedTuple):
    """One number of an effect: `default` None means that it must be given."""

    symbol: str
    unit: str
    default: float | None = 0.0


class Declaration(NamedTuple):
    """An effect's equation, an addition to the base model, and its coefficients in the kernels' order."""

    equation: str
    coefficients: tuple[Coefficient, ...]


def _per_axis(symbol: str, unit: str) -> tuple[Coefficient, Coefficient]:
    return Coefficient(f"{symbol}x", unit), Coefficient(f"{symbol}y", unit)


_LINE = (Coefficient("frequency", "Hz", None), Coefficient("phase_x", "rad"), Coefficient("phase_y", "rad"))

DECLARATIONS: dict[Kind, Declaration] = {
    Kind.CUBIC_STIFFNESS: Declaration("-k3x x^3, -k3y y^3", _per_axis("k3", "1/(m^2 s^2)")),
    Kind.ISOTROPIC_CUBIC_STIFFNESS: Declaration("-k3 r^2 (x, y)", (Coefficient("k3", "1/(m^2 s^2)"),)),
    Kind.QUADRATIC_STIFFNESS: Declaration("-k2x x^2, -k2y y^2", _per_axis("k2", "1/(m s^2)")),
    Kind.NONLINEAR_DAMPING: Declaration("-d3x x^2 x', -d3y y^2 y'", _per_axis("d3", "1/(m^2 s)")),
    Kind.DRY_FRICTION: Declaration(
        "-Fx tanh(x'/v0), -Fy tanh(y'/v0)", (*_per_axis("F", "m/s^2"), Coefficient("v0", "m/s", None))
    ),
    Kind.CONSTANT_FORCE: Declaration("+gx, +gy", _per_axis("g", "m/s^2")),
    Kind.BASE_VIBRATION: Declaration("+ax sin(2 pi f t + psi_x), +ay sin(...)", (*_per_axis("a", "m/s^2"), *_LINE)),
    Kind.DRIVE_GAIN: Declaration("ux -> (1 + gx) ux, uy -> (1 + gy) uy", _per_axis("g", "1")),
    Kind.DRIVE_MISALIGNMENT: Declaration(
        "ux -> ux + exy uy, uy -> uy + eyx ux", (Coefficient("exy", "1"), Coefficient("eyx", "1"))
    ),
    Kind.DRIVE_DELAY: Declaration("u(t - tau)", (Coefficient("tau_x", "s"), Coefficient("tau_y", "s"))),
    Kind.SENSE_GAIN: Declaration("x -> (1 + gx) x, y -> (1 + gy) y", _per_axis("g", "1")),
    Kind.SENSE_CROSS_COUPLING: Declaration(
        "x -> x + exy y, y -> y + eyx x", (Coefficient("exy", "1"), Coefficient("eyx", "1"))
    ),
    Kind.SENSE_QUADRATIC: Declaration("x -> x + a2x x^2, y -> y + a2y y^2", _per_axis("a2", "1/m")),
    Kind.SENSE_CUBIC: Declaration("x -> x + a3x x^3, y -> y + a3y y^3", _per_axis("a3", "1/m^2")),
    Kind.SENSE_DELAY: Declaration("x(t - tau)", (Coefficient("tau_x", "s"), Coefficient("tau_y", "s"))),
    Kind.DRIVE_FEEDTHROUGH: Declaration("V + gamma u", _per_axis("gamma_", "V s^2/m")),
    Kind.INTERFERENCE: Declaration("V + a sin(2 pi f t + psi)", (*_per_axis("a", "V"), *_LINE)),
}


class HiddenEffect(NamedTuple):
    """One `[[effect]]` of a scenario with all its coefficients."""

    kind: Kind
    coefficients: dict[str, float]

    @property
    def name(self) -> str:
        return self.kind.name.lower()


def parse(entry: Any) -> HiddenEffect:
    """The effect of one `[[effect]]` table. Raises ValueError: one line that says what was expected."""
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise ValueError("expected a table with a name and coefficients")
    kinds = {kind.name.lower(): kind for kind in DECLARATIONS}
    name = entry["name"]
    if name not in kinds:
        raise ValueError(f"unknown effect {name!r}; {did_you_mean(name, kinds)}")
    declared = {c.symbol: c.default for c in DECLARATIONS[kinds[name]].coefficients}
    given = {symbol: value for symbol, value in entry.items() if symbol != "name"}
    for symbol, value in given.items():
        if symbol not in declared:
            raise ValueError(f"{name} has no coefficient {symbol!r}; {did_you_mean(symbol, declared)}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueError(f"expected a finite number for {symbol}, got {value!r}")
    missing = [symbol for symbol, default in declared.items() if default is None and symbol not in given]
    if missing or not given:
        raise ValueError(f"{name} needs {', '.join(missing or declared)}")
    return HiddenEffect(kinds[name], {s: float(given.get(s, default or 0)) for s, default in declared.items()})


def table(effects: Iterable[HiddenEffect]) -> NDArray[Any]:
    """The effects as the kernels read them (dtype `EFFECT`)."""
    effects = list(effects)
    rows = np.zeros(len(effects), EFFECT)
    for row, effect in zip(rows, effects, strict=True):
        row["kind"] = effect.kind
        row["c"][: len(effect.coefficients)] = list(effect.coefficients.values())
    return rows


def delay_s(effects: Iterable[HiddenEffect], kind: Kind) -> tuple[float, float]:
    """Total delay in s of the x and the y channel. Delays act on times, not on values: no kernel here."""
    delays = [effect.coefficients for effect in effects if effect.kind == kind]
    return sum(c["tau_x"] for c in delays), sum(c["tau_y"] for c in delays)


@compiled
def force(effects: NDArray[Any], t_s: float, x: float, vx: float, y: float, vy: float) -> tuple[float, float]:
    """Acceleration (m/s²) that the effects add."""
    ax = 0.0
    ay = 0.0
    for effect in effects:
        kind, c = effect.kind, effect.c
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
        elif kind == Kind.DRY_FRICTION:
            ax -= c[0] * math.tanh(vx / c[2])
            ay -= c[1] * math.tanh(vy / c[2])
        elif kind == Kind.CONSTANT_FORCE:
            ax += c[0]
            ay += c[1]
        elif kind == Kind.BASE_VIBRATION:
            phase = 2.0 * math.pi * c[2] * t_s
            ax += c[0] * math.sin(phase + c[3])
            ay += c[1] * math.sin(phase + c[4])
    return ax, ay


@compiled
def drive(effects: NDArray[Any], ux: float, uy: float) -> tuple[float, float]:
    """Force per unit mass (m/s²) that reaches the mass when the converter puts out ux, uy."""
    for effect in effects:
        kind, c = effect.kind, effect.c
        if kind == Kind.DRIVE_GAIN:
            ux, uy = (1.0 + c[0]) * ux, (1.0 + c[1]) * uy
        elif kind == Kind.DRIVE_MISALIGNMENT:
            ux, uy = ux + c[0] * uy, uy + c[1] * ux
    return ux, uy


@compiled
def displacement(effects: NDArray[Any], motion: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """What the two sense combs read of the motion [x, ẋ, y, ẏ], in the same order and units."""
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
    return px, vpx, py, vpy


@compiled
def voltage(effects: NDArray[Any], t_s: float, ux: float, uy: float) -> tuple[float, float]:
    """Voltage that the effects add before the converter, under the force held up to the sampling instant."""
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
    return vx, vy
