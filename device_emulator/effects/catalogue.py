"""The effects by name: equation, coefficients, units; and how a scenario's tables are read."""

import math
from collections.abc import Iterable
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from device_emulator.section import did_you_mean

MAX_COEFFICIENTS = 6
MAX_INNER = 12
"""States that all effects of a device may have together, beside the four of the mass."""

EFFECT = np.dtype([("kind", "i8"), ("at", "i8"), ("c", "f8", (MAX_COEFFICIENTS,))], align=True)
"""`at` is the first of an effect's own states in the vector [x, ẋ, y, ẏ, …]."""


class Kind(IntEnum):
    """The effects, in no order that matters."""

    CUBIC_STIFFNESS = 1
    ISOTROPIC_CUBIC_STIFFNESS = 2
    QUADRATIC_STIFFNESS = 3
    NONLINEAR_DAMPING = 4
    DRY_FRICTION = 5
    CONSTANT_FORCE = 6
    BASE_VIBRATION = 7
    ASYMMETRIC_FRICTION = 8
    NONRECIPROCAL_STIFFNESS = 9
    ANGULAR_GAIN = 10
    THERMAL_STIFFNESS = 11
    THERMAL_DAMPING = 12
    BACKLASH = 13
    HYSTERETIC_STIFFNESS = 14
    STICK_SLIP_SUPPORT = 15
    PARAMETRIC_STIFFNESS = 16
    NONLINEAR_COUPLING = 17
    UNEQUAL_MASSES = 18
    DRIVE_GAIN = 20
    DRIVE_MISALIGNMENT = 21
    DRIVE_DELAY = 22
    DRIVE_SATURATION = 23
    DRIVE_DEAD_BAND = 24
    DRIVE_SLEW = 25
    ELECTROSTATIC_DRIVE = 26
    DRIVE_POLARITY = 27
    SENSE_GAIN = 40
    SENSE_CROSS_COUPLING = 41
    SENSE_QUADRATIC = 42
    SENSE_CUBIC = 43
    SENSE_DELAY = 44
    PARASITIC_MODE = 45
    SENSE_POLARITY = 46
    DRIVE_FEEDTHROUGH = 60
    INTERFERENCE = 61
    THERMAL_OFFSET = 62
    TELEGRAPH_OFFSET = 63
    SENSE_SATURATION = 64
    MISSING_CODES = 65


class Coefficient(NamedTuple):
    """One number of an effect: `default` None means that it must be given; `positive`, that it must be above 0;
    `switch`, that it is 0 or 1; `above`, that it must be above that.
    """

    symbol: str
    unit: str
    default: float | None = 0.0
    positive: bool = False
    switch: bool = False
    above: float = -math.inf


class Declaration(NamedTuple):
    """An effect's equation, an addition to the base model; its coefficients in the kernels' order; how many states of
    its own it has.
    """

    equation: str
    coefficients: tuple[Coefficient, ...]
    states: int = 0


def _per_axis(symbol: str, unit: str) -> tuple[Coefficient, Coefficient]:
    return Coefficient(f"{symbol}x", unit), Coefficient(f"{symbol}y", unit)


def _given(symbol: str, unit: str) -> Coefficient:
    return Coefficient(symbol, unit, None, positive=True)


def _switches() -> tuple[Coefficient, Coefficient]:
    return Coefficient("px", "1", switch=True), Coefficient("py", "1", switch=True)


def _limits(symbol: str, unit: str) -> tuple[Coefficient, Coefficient]:
    return _given(f"{symbol}x", unit), _given(f"{symbol}y", unit)


_LINE = (Coefficient("frequency", "Hz", None), Coefficient("phase_x", "rad"), Coefficient("phase_y", "rad"))
_FRICTION = (*_per_axis("F", "m/s^2"), _given("v0", "m/s"))

DECLARATIONS: dict[Kind, Declaration] = {
    Kind.CUBIC_STIFFNESS: Declaration("-k3x x^3, -k3y y^3", _per_axis("k3", "1/(m^2 s^2)")),
    Kind.ISOTROPIC_CUBIC_STIFFNESS: Declaration("-k3 r^2 (x, y)", (Coefficient("k3", "1/(m^2 s^2)"),)),
    Kind.QUADRATIC_STIFFNESS: Declaration("-k2x x^2, -k2y y^2", _per_axis("k2", "1/(m s^2)")),
    Kind.NONLINEAR_DAMPING: Declaration("-d3x x^2 x', -d3y y^2 y'", _per_axis("d3", "1/(m^2 s)")),
    Kind.DRY_FRICTION: Declaration("-Fx tanh(x'/v0), -Fy tanh(y'/v0)", _FRICTION),
    Kind.ASYMMETRIC_FRICTION: Declaration(
        "-Fx (T + ax T^2) with T = tanh(x'/v0), -Fy (...): F (1 + a) forth, F (1 - a) back",
        (*_FRICTION, *_per_axis("a", "1")),
    ),
    Kind.CONSTANT_FORCE: Declaration("+gx, +gy", _per_axis("g", "m/s^2")),
    Kind.BASE_VIBRATION: Declaration("+ax sin(2 pi f t + psi_x), +ay sin(...)", (*_per_axis("a", "m/s^2"), *_LINE)),
    Kind.NONRECIPROCAL_STIFFNESS: Declaration("-kn y, +kn x", (Coefficient("kn", "1/s^2"),)),
    Kind.ANGULAR_GAIN: Declaration(
        "Coriolis and Euler force times 1 + kappa: +kappa (2 W y' + W' y), -kappa (2 W x' + W' x)",
        (Coefficient("kappa", "1"),),
    ),
    Kind.THERMAL_STIFFNESS: Declaration("K (1 + tc (T - T0))", (Coefficient("tc", "1/K"),)),
    Kind.THERMAL_DAMPING: Declaration("D (1 + tc (T - T0))", (Coefficient("tc", "1/K"),)),
    Kind.BACKLASH: Declaration(
        "-kbx (x - clip(x, -gap, gap)), -kby (...): a spring with play",
        (*_per_axis("kb", "1/s^2"), _given("gap", "m")),
    ),
    Kind.HYSTERETIC_STIFFNESS: Declaration(
        "-khx zx, zx' = x' - (|x'| zx + x' |zx|) / (2 reach); y likewise (Bouc and Wen, exponent 1)",
        (*_per_axis("kh", "1/s^2"), _given("reach", "m")),
        states=2,
    ),
    Kind.STICK_SLIP_SUPPORT: Declaration(
        "the package, 1/ratio as heavy as the mass, rests on springs and friction (LuGre): -X'', "
        "X'' = ratio r - (2 pi f)^2 X - s z - sqrt(s) z', z' = X' - s |X'| z / g, "
        "g = Fc + (Fs - Fc) exp(-(X'/vs)^2), r = K x + D x' - u; Y likewise",
        (
            _given("ratio", "1"),
            _given("frequency", "Hz"),
            _given("Fs", "m/s^2"),
            _given("Fc", "m/s^2"),
            _given("vs", "m/s"),
            _given("s", "1/s^2"),
        ),
        states=6,
    ),
    Kind.PARAMETRIC_STIFFNESS: Declaration(
        "K (1 + depth sin(2 pi f t + psi))",
        (Coefficient("depth", "1"), _given("frequency", "Hz"), Coefficient("phase", "rad")),
    ),
    Kind.NONLINEAR_COUPLING: Declaration("-3 c x^2 y, -c x^3: potential c x^3 y", (Coefficient("c", "1/(m^2 s^2)"),)),
    Kind.UNEQUAL_MASSES: Declaration(
        "y moves 1 + m times the mass of x: all of y'' but W^2 y over 1 + m, Coriolis and Euler force being "
        "of the mass that both move",
        (Coefficient("m", "1", None, above=-1.0),),
    ),
    Kind.DRIVE_GAIN: Declaration("ux -> (1 + gx) ux, uy -> (1 + gy) uy", _per_axis("g", "1")),
    Kind.DRIVE_MISALIGNMENT: Declaration(
        "ux -> ux + exy uy, uy -> uy + eyx ux", (Coefficient("exy", "1"), Coefficient("eyx", "1"))
    ),
    Kind.DRIVE_DELAY: Declaration("u(t - tau)", (Coefficient("tau_x", "s"), Coefficient("tau_y", "s"))),
    Kind.DRIVE_SATURATION: Declaration("ux -> clip(ux, -limit_x, limit_x)", _limits("limit_", "m/s^2")),
    Kind.DRIVE_DEAD_BAND: Declaration("ux -> ux - clip(ux, -width_x, width_x)", _per_axis("width_", "m/s^2")),
    Kind.DRIVE_SLEW: Declaration("|du/dt| <= slew, after every delay", _limits("slew_", "m/s^3")),
    Kind.ELECTROSTATIC_DRIVE: Declaration("ux -> ux + ex ux^2, uy -> uy + ey uy^2", _per_axis("e", "s^2/m")),
    Kind.DRIVE_POLARITY: Declaration("ux -> -ux where px = 1, uy -> -uy where py = 1", _switches()),
    Kind.SENSE_GAIN: Declaration("x -> (1 + gx) x, y -> (1 + gy) y", _per_axis("g", "1")),
    Kind.SENSE_CROSS_COUPLING: Declaration(
        "x -> x + exy y, y -> y + eyx x", (Coefficient("exy", "1"), Coefficient("eyx", "1"))
    ),
    Kind.SENSE_QUADRATIC: Declaration("x -> x + a2x x^2, y -> y + a2y y^2", _per_axis("a2", "1/m")),
    Kind.SENSE_CUBIC: Declaration("x -> x + a3x x^3, y -> y + a3y y^3", _per_axis("a3", "1/m^2")),
    Kind.SENSE_DELAY: Declaration("x(t - tau)", (Coefficient("tau_x", "s"), Coefficient("tau_y", "s"))),
    Kind.SENSE_POLARITY: Declaration(
        "x -> -x where px = 1, y -> -y where py = 1, after what stands before it", _switches()
    ),
    Kind.PARASITIC_MODE: Declaration(
        "x -> x + px, px'' + 2 zeta w px' + w^2 px = gamma_x ux, w = 2 pi f; y likewise",
        (_given("frequency", "Hz"), _given("zeta", "1"), *_per_axis("gamma_", "1")),
        states=4,
    ),
    Kind.DRIVE_FEEDTHROUGH: Declaration("V + gamma u", _per_axis("gamma_", "V s^2/m")),
    Kind.INTERFERENCE: Declaration("V + a sin(2 pi f t + psi)", (*_per_axis("a", "V"), *_LINE)),
    Kind.THERMAL_OFFSET: Declaration("V + tc (T - T0)", _per_axis("tc_", "V/K")),
    Kind.TELEGRAPH_OFFSET: Declaration(
        "V + a s, s = 1 or -1, changing at random `rate` times a second",
        (*_per_axis("a", "V"), _given("rate", "1/s")),
        states=2,
    ),
    Kind.SENSE_SATURATION: Declaration(
        "V -> clip(V, -limit_x, limit_x), before noise and converter", _limits("limit_", "V")
    ),
    Kind.MISSING_CODES: Declaration(
        "codes n every ... n every + width - 1 all read n every", (_given("every", "1"), _given("width", "1"))
    ),
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
    declared = {c.symbol: c for c in DECLARATIONS[kinds[name]].coefficients}
    given = {symbol: value for symbol, value in entry.items() if symbol != "name"}
    for symbol, value in given.items():
        if symbol not in declared:
            raise ValueError(f"{name} has no coefficient {symbol!r}; {did_you_mean(symbol, declared)}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueError(f"expected a finite number for {symbol}, got {value!r}")
        if declared[symbol].positive and value <= 0:
            raise ValueError(f"expected a number above 0 for {symbol}, got {value!r}")
        if declared[symbol].switch and value not in (0, 1):
            raise ValueError(f"expected 0 or 1 for {symbol}, got {value!r}")
        if value <= declared[symbol].above:
            raise ValueError(f"expected a number above {declared[symbol].above:g} for {symbol}, got {value!r}")
    missing = [symbol for symbol, c in declared.items() if c.default is None and symbol not in given]
    if missing or not given:
        raise ValueError(f"{name} needs {', '.join(missing or declared)}")
    return HiddenEffect(kinds[name], {s: float(given.get(s, c.default or 0)) for s, c in declared.items()})


def table(effects: Iterable[HiddenEffect]) -> NDArray[Any]:
    """The effects as the kernels read them (dtype `EFFECT`)."""
    effects = list(effects)
    rows = np.zeros(len(effects), EFFECT)
    at = 4
    for row, effect in zip(rows, effects, strict=True):
        row["kind"] = effect.kind
        row["at"] = at
        row["c"][: len(effect.coefficients)] = list(effect.coefficients.values())
        at += DECLARATIONS[effect.kind].states
    return rows


def inner_states(effects: Iterable[HiddenEffect]) -> int:
    """How many states the effects have of their own."""
    return sum(DECLARATIONS[effect.kind].states for effect in effects)


def delay_s(effects: Iterable[HiddenEffect], kind: Kind) -> tuple[float, float]:
    """Total delay in s of the x and the y channel. Delays act on times, not on values: no kernel here."""
    delays = [effect.coefficients for effect in effects if effect.kind == kind]
    return sum(c["tau_x"] for c in delays), sum(c["tau_y"] for c in delays)


def slew_mps3(effects: Iterable[HiddenEffect]) -> tuple[float, float]:
    """Steepest change of the drive per axis, infinite without a limit."""
    slews = [effect.coefficients for effect in effects if effect.kind == Kind.DRIVE_SLEW]
    x, y = (min([math.inf, *(c[f"slew_{axis}"] for c in slews)]) for axis in "xy")
    return x, y


def resonance_Hz(effects: Iterable[HiddenEffect]) -> float:
    """The highest resonance among the effects' own, 0 without any."""
    own = [effect.coefficients["frequency"] for effect in effects if effect.kind == Kind.PARASITIC_MODE]
    own += [
        math.sqrt(effect.coefficients["s"]) / (2.0 * math.pi)
        for effect in effects
        if effect.kind == Kind.STICK_SLIP_SUPPORT
    ]
    return max(own, default=0.0)
