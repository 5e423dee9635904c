"""What an effect is: a force, a distortion of the measurement, or both, that the base model lacks.

Declared for SymPy (`estimator.model.formula`) over the states and drives of the two-axis gyro; on a single axis y, ẏ
and uy are zero and the coefficients that then act on nothing drop out.  All that is known of an effect stands in its
declaration: equation, units, plausible sizes, what it looks like, what undoes it, and where it comes from.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, TypeVar

from estimator.effects.search import Search
from estimator.model.formula import as_declared, in_sympy, is_nothing, names_in, symbol, symbolic, without

if TYPE_CHECKING:
    import sympy as sp

_Declared = TypeVar("_Declared")

OWN = -1
"""In place of the number of an effect that is not of the catalogue: `estimator.core.own` has its code."""


class Compensation(Enum):
    """How an effect is kept out of the angle once its coefficients are known."""

    CANCEL = "the control law subtracts its force"
    INVERT = "the control law divides by it"
    PREDICT = "the control law predicts that much further ahead"
    MAP = "the observer's state has it taken out of the measurement"
    NONE = "not yet: a loop that declares it is refused"


class Source(Enum):
    """Where a signal comes from; the number is what the kernel dispatches on."""

    PARAMETER = 0  # the effect's parameter of the same symbol, a constant
    COSINE = 1  # cos ωt with ω the effect's first parameter
    SINE = 2
    TEMPERATURE = 3  # measured, less its first value
    INTEGRAL = 4  # ∫ drive dt of an axis, leaking at the rate of the parameter `behind`
    RESONATOR = 5  # p of p̈ + 2ζω ṗ + ω² p = drive of an axis, with ω, ζ the first two parameters
    DIRECTION = 6  # tanh(v/v0) of an axis, v0 the first parameter; the flow stops where the velocity turns
    DECAY = 7  # exp(−λt) from the first sample on, with λ the parameter of that axis
    LAG = 8  # drive of an axis behind a first-order lag, its time constant the coefficient `behind`
    WANE = 9  # exp(−t/T) from the first sample on, T the coefficient `behind`
    TIME = 10  # 0 one sample interval before the first sample, as for COSINE and SINE
    SLIP = 11  # z of ż = ẋ against z, ẋ (1 − |z|/reach) along it, of an axis; reach the coefficient `behind`
    STOP = 12  # x of an axis less what follows it with play, never beyond the half-width, the coefficient `behind`


OF_THE_WAY = (Source.SLIP, Source.STOP)
"""Signals that depend on the way that the mass came: the flow carries them, and their sensitivities."""


class Delayed(Enum):
    """Which path of an axis is late by the effect's coefficients, exactly."""

    SENSE = "sense"
    DRIVE = "drive"


@symbolic("symbol", "found_as")
@dataclass(frozen=True)
class Parameter:
    """A number of an effect that is given, not estimated: a frequency, a threshold; tracing searches for it.

    length, time, kelvin, volt: powers of metre, second, kelvin and volt in its SI unit, per unit mass; default: in
    scaled units, where there is a sensible one, which a trace keeps; choices: the only values it may have, none: any;
    above: below or at that there is no such device; tried: in scaled units, from where a trace begins its search;
    found_as: the effect's coefficient that it is the same number as, where it is one: then a trace takes it from there.
    """

    symbol: "sp.Symbol"
    name: str
    length: int = 0
    time: int = 0
    default: float | None = None
    choices: tuple[float, ...] = ()
    above: float = -math.inf
    kelvin: int = 0
    volt: int = 0
    tried: tuple[float, ...] = ()
    found_as: "sp.Symbol | None" = None

    @property
    def unit(self) -> str:
        """The SI unit."""
        return si_unit(self.length, self.time, self.kelvin, self.volt)


@symbolic("symbol", "behind")
@dataclass(frozen=True)
class Signal:
    """A series that an effect depends on beside state and drive, computed sample by sample from what is measured.

    behind: the effect's coefficient that it hangs on, or its parameter, where it does.
    """

    symbol: "sp.Symbol"
    source: Source
    axis: int = 0
    behind: "sp.Symbol | None" = None


@symbolic("symbol")
@dataclass(frozen=True)
class Coefficient:
    """A number an effect has.

    length, time, kelvin, volt: powers of metre, second, kelvin and volt in its SI unit, per unit mass, a scaled unit of
    voltage being that of the amplitude on x; plausible: its largest likely size in scaled units (amplitude 1, ω0 1),
    the standard deviation with which it enters an observer; positive: a negative value would be no such effect
    (friction that drives); start: in scaled units, where an observer begins that is not told;
    least: in scaled units, no fit goes below that; own: of where a record begins, so that each record has its own;
    bent: whether the measurement is far from linear in it, so that a derivative at zero does not tell its size.
    """

    symbol: "sp.Symbol"
    name: str
    plausible: float
    length: int = 0
    time: int = 0
    kelvin: int = 0
    positive: bool = False
    volt: int = 0
    start: float = 0.0
    least: float = -math.inf
    own: bool = False
    bent: bool = False

    @property
    def is_shape(self) -> bool:
        """Whether it says how the effect is, and not how large."""
        return self.start != 0.0

    @property
    def unit(self) -> str:
        """The SI unit."""
        return si_unit(self.length, self.time, self.kelvin, self.volt)


@symbolic("force", "sense", "alone")
@dataclass(frozen=True)
class Effect:
    """Force per unit mass added to (ẍ, ÿ), and displacement added to what each axis senses, in scaled units.

    `force` and `sense` may depend on states, drives, coefficients, signals and the constants of the base model; both
    are zero where not given.  `delayed` names the path that is late by the coefficients, one per axis.  `alone` is what
    a single axis senses, whose base model has other constants, where `sense` depends on those of two axes.  `shown` are
    its equations, a line an axis, where the expressions are only their solution.

    The rest is how a trace looks for it: `search`, where its parameters come from; `gain`, whether its coefficients are
    relative to a declared gain, which has the other sign where they are below −1; `plane`, whether it is the radial
    form of another effect, which is all that a single axis has of it; `rare`, whether it is no law of an envelope.
    `number` is its place in the catalogue, by which the core knows it.

    An effect without coefficients is `declared_only`: what it does no record can tell from something else, so it is
    never a candidate of a search, and a user who measured it otherwise gives its parameters.
    """

    name: str
    title: str
    coefficients: tuple[Coefficient, ...]
    source: str
    signature: str
    compensation: Compensation
    force: "tuple[sp.Expr, sp.Expr]" = (0, 0)
    sense: "tuple[sp.Expr, sp.Expr]" = (0, 0)
    look_alikes: Mapping[str, str] = field(default_factory=dict)
    parameters: tuple[Parameter, ...] = ()
    signals: tuple[Signal, ...] = ()
    delayed: Delayed | None = None
    alone: "sp.Expr | None" = None
    shown: tuple[str, ...] = ()
    number: int = OWN
    search: Search | None = None
    gain: bool = False
    plane: bool = False
    rare: bool = False

    @property
    def slips(self) -> bool:
        """Whether its force depends on the way that the mass came."""
        return any(signal.source in OF_THE_WAY for signal in self.signals)

    @property
    def runs_freely(self) -> bool:
        """Whether a search names it by free runs only: it depends on the way, or on where a record begins."""
        return self.slips or any(coefficient.own for coefficient in self.coefficients)

    @property
    def declared_only(self) -> bool:
        """Whether nothing of it could be estimated from a record."""
        return not self.coefficients

    @property
    def pushes(self) -> bool:
        """Whether it is a force."""
        return not all(is_nothing(force) for force in as_declared(self, "force"))

    def labelled(self, label: str) -> "Effect":
        """One of several of the same kind: names of effect and coefficients carry the label."""
        coefficients = tuple(_with(c, name=f"{c.name}:{label}") for c in self.coefficients)
        return _with(self, name=f"{self.name}:{label}", coefficients=coefficients)

    def of_several(self, called: "Sequence[Callable[[str], str]]") -> "Effect":
        """One of several records: what hangs on where a record begins is there for each, by the name that it has."""
        each = ([_with(c, name=name(c.name)) for name in called] if c.own else [c] for c in self.coefficients)
        return _with(self, coefficients=tuple(one for several in each for one in several))

    def on(self, axes: int) -> "Effect | None":
        """The effect on a device with that many axes, None where nothing of it is left."""
        if axes == 2:
            return self
        if self.plane:
            return None
        if self.delayed is not None:
            return _with(self, coefficients=self.coefficients[:1])
        alone = as_declared(self, "alone")
        force = _of_one_axis(as_declared(self, "force")[0])
        sense = _of_one_axis(as_declared(self, "sense")[0] if alone is None else alone)
        asked = names_in((force, sense))
        asked |= {name_of(s, "behind") for s in self.signals if name_of(s) in asked}
        left = tuple(c for c in self.coefficients if name_of(c) in asked)
        if not left:
            return None
        signals = self.signals if alone is None else tuple(s for s in self.signals if name_of(s) in asked)
        return _with(self, coefficients=left, force=(force, 0), sense=(sense, 0), signals=signals)


def name_of(declaration: "Coefficient | Parameter | Signal", field_name: str = "symbol") -> str:
    """Name of its symbol, or of another symbolic field; "" for none."""
    symbol = as_declared(declaration, field_name)
    return "" if symbol is None else str(symbol)


def _of_one_axis(expression: Any) -> Any:
    """What is left of an expression on a single axis."""
    absent = ("y", "vy", "uy")
    if hasattr(expression, "subs"):  # one of SymPy's, of a declaration of somebody's own
        return expression.subs(dict.fromkeys(absent, 0))
    return without(expression, absent)


def _with(declaration: _Declared, **changed: Any) -> _Declared:
    """`dataclasses.replace`, which leaves formulas as they were declared."""
    other = copy(declaration)
    other.__dict__.update(changed)
    return other


def si_unit(length: int, time: int, kelvin: int = 0, volt: int = 0) -> str:
    """Unit of those powers of metre, second, kelvin and volt."""
    named = (("m", length), ("s", time), ("K", kelvin), ("V", volt))
    powers = [(name, power) for name, power in named if power]
    above = "·".join(name + _superscript(power) for name, power in powers if power > 0)
    below = "·".join(name + _superscript(-power) for name, power in powers if power < 0)
    return (above or "1") + (f"/({below})" if "·" in below else f"/{below}" if below else "")


def __getattr__(name: str) -> Any:
    """STATES and DRIVES: the symbols of the motion and of the drives, as SymPy has them."""
    names = {"STATES": ("x", "vx", "y", "vy"), "DRIVES": ("ux", "uy")}.get(name)
    if names is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return tuple(in_sympy(symbol(one)) for one in names)


def _superscript(power: int) -> str:
    return "" if power == 1 else str(power).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))
