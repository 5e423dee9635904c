"""What the amplitude of a ring-down is predicted to be: linear damping, laws beside it, and what is no motion.

Parameters are ln a at the first sample, the linear damping, a coefficient for each law, and, where it is included, the
power of the noise that the sensor takes for amplitude: what is shown is √(a² + n²).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.integrate import cumulative_trapezoid

from estimator.chance import TWO_SIDED
from estimator.diagnosis import Interval
from estimator.effects.equation import equations_on
from estimator.envelope.course import Power, level_at
from estimator.envelope.laws import LINEAR, Law, laws
from estimator.envelope.record import DECIBEL, Envelope, Resonator
from estimator.errors import ModelError
from estimator.scaling import Array
from estimator.trace.fit import FittedModel
from estimator.trace.likelihood import Evaluation, Model, Size
from estimator.trace.output_error import OutputError, OutputLayout, Predicted, Rows, Term
from estimator.trace.problem import Effects

FLOOR = "noise_floor"
"""Name of what the reading has beside the motion."""
FOLLOWED = 3.0
"""Nepers below the lowest reading to which a motion is followed."""
NEPERS = 10.0
"""Prior deviation of the level at the first sample: the record tells it."""
SHOWN = 0.1
"""Of the declared amplitude, noise that may be taken for it."""


@dataclass(frozen=True, kw_only=True)
class Taken(Term):
    """One thing that an amplitude may show beside linear damping: a law, or, with none, the noise floor.

    plausible: size of the coefficient, scaled; factor: SI of one scaled unit; power: of the resonance in it.
    """

    plausible: float
    factor: float
    power: int
    law: Law | None = None


@cache
def all_taken(resonator: Resonator) -> dict[str, Taken]:
    """The laws of the catalogue and those of one's own, and the noise floor."""
    scaling = resonator.scaling
    found = {
        name: Taken(
            title=law.effect.title, equations=(*equations_on(law.effect, 1), law.equation),
            coefficients=(Size(law.coefficient.name, law.coefficient.unit, law.coefficient.positive),),
            compensation=law.effect.compensation.value, look_alikes=law.effect.look_alikes,
            plausible=law.coefficient.plausible, factor=scaling.coefficient(law.coefficient),
            power=1 + law.coefficient.time, law=law,
        )
        for name, law in laws(resonator.device.own).items()
    }  # fmt: skip
    found[FLOOR] = Taken(
        title="Noise that the sensor takes for amplitude", equations=("shown a = sqrt(a**2 + n**2)",),
        coefficients=(Size("n", "m", positive=True),), compensation="nothing to undo in the device",
        plausible=SHOWN**2, factor=scaling.length, power=0,
    )  # fmt: skip
    return found


@dataclass(frozen=True)
class RingDown(OutputError):
    """`Likelihood` of an envelope.  Raises ModelError for an amplitude that does not fall."""

    envelope: Envelope
    resonator: Resonator

    def __post_init__(self) -> None:
        if not self.line[0] < 0.0:
            raise ModelError("the amplitude does not fall; an envelope is traced as it rings down")

    @cached_property
    def line(self) -> tuple[float, float]:
        """Slope by scaled time, and ln a at the first sample, of the straight line through the logarithm."""
        slope, start = np.polyfit(self.time, self.envelope.level_over(self.resonator.unit), 1)
        return float(slope), float(start)

    @property
    def taken(self) -> dict[str, Taken]:
        """What may be found."""
        return all_taken(self.resonator)

    @property
    def reading(self) -> Array:
        return self.envelope.shown

    @property
    def along(self) -> Array:
        """Time (n,) s."""
        return self.envelope.time

    @cached_property
    def time(self) -> Array:
        """Scaled, from the first sample."""
        return np.asarray((self.envelope.time - self.envelope.time[0]) * self.resonator.scaling.omega0)

    def upto(self, samples: int) -> "RingDown":
        one = self.envelope
        return replace(self, envelope=Envelope(one.time[:samples], one.shown[:samples], one.logarithmic))

    def layout(self, effects: Effects) -> OutputLayout:
        """ln a at the first sample, damping, then one for each term."""
        omega0 = self.resonator.scaling.omega0
        damping, spread = self.resonator.damping
        terms = [self.taken[name] for name in effects]
        start = damping if damping > 0.0 else -self.line[0] / LINEAR * omega0
        k = 2 + len(terms)
        return OutputLayout(
            names=("ln a", "dxx", *(term.coefficients[0].name for term in terms)), owner=("", "", *effects),
            mean=np.array([self.line[1], start / spread, *self._starts(effects)]),
            deviation=np.array([NEPERS, *np.ones(k - 1)]), least=np.full(k, -np.inf), most=np.full(k, np.inf),
            factor=np.array([1.0, spread, *(term.plausible * term.factor for term in terms)]), effects=effects,
        )  # fmt: skip

    def _starts(self, effects: Effects) -> list[float]:
        """Of the coefficients, scaled."""
        return [next(iter(given.values()), 0.0) / (self.taken[name].factor * self.taken[name].plausible)
                for name, given in effects.items()]  # fmt: skip

    def balance(self, names: Sequence[str], told: Rows) -> Array:
        """ln a at the first sample, damping and the coefficients of laws, scaled, as the record balances: what ln a has
        fallen by is linear in them, where the amplitudes are those that were read (equation error; Ljung, ch. 7).
        """
        level = self.envelope.level_over(self.resonator.unit)
        laws = [law for name in names if (law := self.taken[name].law) is not None]
        powers = [(LINEAR, 1.0), *((law.size, law.degree) for law in laws)]
        rates = [size * np.exp((degree - 1.0) * level) for size, degree in powers]
        fallen = [cumulative_trapezoid(rate, self.time, initial=0.0) for rate in rates]
        matrix = np.column_stack([np.ones(len(level)), *(-one for one in fallen)])[told]
        size = np.linalg.norm(matrix, axis=0)
        return np.asarray(np.linalg.lstsq(matrix / size, level[told], rcond=None)[0] / size)

    def balanced(self, layout: OutputLayout, theta: Array) -> Array:
        """Where the record balances, as far as it shows a ring-down there."""
        names = [name for name in layout.owner[2:] if self.taken[name].law is not None]
        start, damping, *sizes = self.balance(names, self.told)
        theta = theta.copy()
        theta[0], theta[1] = start, damping * self.resonator.scaling.omega0 / layout.factor[1]
        for name, size in zip(names, sizes, strict=True):
            theta[layout.of(name)] = size / self.taken[name].plausible
        return theta

    def predicted(self, layout: OutputLayout, theta: Array) -> Predicted:
        """What the sensor shows.  Raises ModelError for a motion that is no ring-down."""
        terms = [self.taken[name] for name in layout.owner[2:]]
        given = [theta[k] * term.plausible for k, term in enumerate(terms, start=2)]
        acting = [(c, term.law) for c, term in zip(given, terms, strict=True) if term.law is not None]
        damping = theta[1] * layout.factor[1] / self.resonator.scaling.omega0
        powers = [Power(LINEAR, 1.0), *(Power(law.size, law.degree) for _, law in acting)]
        unit = self.resonator.unit
        lowest = min(float(np.min(self.envelope.level_over(unit))) - FOLLOWED, float(theta[0]) - 1.0)
        level = level_at(self.time, float(theta[0]), np.array([damping, *(c for c, _ in acting)]), powers, lowest)
        floor = sum(c for c, term in zip(given, terms, strict=True) if term.law is None)
        if floor:
            level = 0.5 * np.log(np.maximum(np.exp(2.0 * level) + floor, np.finfo(float).tiny))
        shown = DECIBEL * (level + math.log(unit)) if self.envelope.logarithmic else unit * np.exp(level)
        if not np.all(np.isfinite(shown)):
            raise ModelError("the amplitude leaves all bounds")
        return Predicted(shown, np.zeros((len(shown), 0)), np.ones(len(shown), dtype=bool))

    def effect(self, name: str) -> Taken:
        return self.taken[name]

    def candidates(self, model: Model, evaluation: Evaluation) -> Effects:
        """Terms that are not in a model; of laws of one power, which an amplitude does not tell apart, the first."""
        powers = {self._degree(name) for name in model.effects}
        found: dict[str, Mapping[str, float]] = {}
        for name in self.taken:
            if self._degree(name) not in powers:
                powers.add(self._degree(name))
                found[name] = self._start(model.effects, name)
        return found

    def _start(self, included: Effects, name: str) -> Mapping[str, float]:
        """Of a law beside others, SI; none, where the record balances without."""
        term, others = self.taken[name], [one for one in included if self.taken[one].law is not None]
        size = self.balance([*others, name], np.arange(len(self.reading)))[-1] if term.law is not None else 0.0
        return {term.coefficients[0].name: float(size * term.factor)} if size > 0.0 else {}

    def _degree(self, name: str) -> float | None:
        law = self.taken[name].law
        return None if law is None else law.degree

    def interval(self, model: FittedModel, k: int) -> Interval:
        """SI; allows for what the resonance is known to."""
        if not model.layout.owner[k]:
            return model.interval(k, "1/s")
        term = self.taken[model.layout.owner[k]]
        value, half = (float(one) * term.plausible for one in (model.model.theta[k], TWO_SIDED * model.deviations[k]))
        if term.law is None:  # n from its power
            root = math.sqrt(abs(value))
            value, half = math.copysign(root, value), half / (2.0 * root) if root else math.inf
        half = math.hypot(half, TWO_SIDED * term.power * self.resonator.frequency_sd * value)
        size = term.factor
        return Interval(size * value, size * (value - half), size * (value + half), term.coefficients[0].unit)

    def same(self, name: str, found: Mapping[str, Interval]) -> Mapping[str, tuple[str, str]]:
        """The laws of one power, which take the same energy from a cycle."""
        own = self.taken[name]
        others = {
            other: term for other, term in self.taken.items()
            if other != name and term.law is not None and self._degree(other) == self._degree(name)
        }  # fmt: skip
        told_by = "the waveform: the two take the same energy from a cycle, at other places in it"
        return {other: (told_by, _as_another(name, own, found, other, term)) for other, term in others.items()}

    def said(self, model: FittedModel) -> tuple[str, ...]:
        """Damping and quality factor."""
        one = self.interval(model, 1)
        quality = self.resonator.scaling.omega0 / one.value if one.value > 0.0 else math.inf
        return (
            f"linear damping is {one.value:.4g} 1/s [{one.low:.4g}, {one.high:.4g}], a quality factor of {quality:.4g}",
        )


def _as_another(name: str, own: Taken, found: Mapping[str, Interval], other: str, term: Taken) -> str:
    """What else a law may be, with the coefficient that it then has."""
    assert own.law is not None  # both are laws
    assert term.law is not None
    factor = own.law.size * term.factor / (term.law.size * own.factor)
    one, it = found[own.coefficients[0].name], term.coefficients[0]
    return (
        f"an amplitude does not tell {name} from {other} with {it.name} = {factor * one.value:.4g} "
        f"[{factor * one.low:.4g}, {factor * one.high:.4g}] {it.unit}"
    )
