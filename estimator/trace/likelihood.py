"""One pass of the filter over a record: innovations, their likelihood, and its derivatives by any parameters."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Protocol

import numpy as np

from estimator.effects.declaration import Coefficient as EffectCoefficient
from estimator.effects.declaration import Effect, Parameter, name_of
from estimator.effects.labels import kind
from estimator.effects.search import Search
from estimator.observer import Observer
from estimator.scaling import Array, Scaling
from estimator.settings import Gain, ObserverSettings, Variant
from estimator.thresholds import THRESHOLDS
from estimator.trace.examination import Examination
from estimator.trace.noise import level
from estimator.trace.problem import Effects, Problem

BLOCKS = 24
"""Parts of a record whose scores are taken as independent: longer than the memory of any filter that follows."""
SHIFT = 1e-5
"""Of a searched parameter, over which the innovations' difference is taken: small beside any curvature."""
LEAST = 1e-3
"""Of where a search begins a parameter, below which it does not go."""
SPEED = (1, -1)
"""Powers of length and time in the unit of a velocity."""
AT_FLOOR = THRESHOLDS.criterion.floor
"""Innovation over the noise floor, rms, that a complete model may leave."""
RARE = THRESHOLDS.criterion.chance
"""How often a check fails where all is well, and how often an effect may be named that is not there."""
TIE = THRESHOLDS.criterion.tie
"""Of twice the log-likelihood, below which two accounts are told together."""


@dataclass(frozen=True)
class Noise:
    """What is assumed of the noise, times what is declared (1 for all of it) or, where nothing is, in its own unit.

    sense: factor on the standard deviation of each channel; force [m/s²/√Hz]; rate [rad/s/√s];
    independent: share of the samples, for an error that is coloured.
    """

    sense: tuple[float, ...]
    force: float
    rate: float
    independent: float = 1.0


@dataclass(frozen=True)
class Model:
    """A model of the record: what is in it beside the base model, the value of each parameter, the noise.

    effects: names, each with the parameters that are given, SI; theta: scaled constants, coefficients and searched
    parameters, in the order of `Layout.names`.
    """

    effects: Effects
    theta: Array
    noise: Noise


@dataclass(frozen=True)
class Evaluation:
    """A pass over a record.

    score (blocks, k), information (blocks, k, k): of twice the log-likelihood's half by the parameters, scaled, by
    part of the record, both at the noise that the pass assumed; power (blocks,) sum of squared whitened innovations;
    logs (blocks,) of the logarithms of their deviations; count (blocks,) of innovations; innovation (n, axes) V and
    its deviation, NaN where nothing was measured; share of the samples that is independent, by which all sums are less;
    records: of several, their names: each has as many parts, one after another.
    """

    names: tuple[str, ...]
    score: Array
    information: Array
    power: Array
    logs: Array
    count: Array
    innovation: Array
    deviation: Array
    share: float = 1.0
    records: tuple[str, ...] = ()

    @classmethod
    def of_parts(cls, seen: "Sequence[Evaluation]", records: tuple[str, ...] = ()) -> "Evaluation":
        """Passes with the same parameters, one after another; records: their names, where each is one of its own."""
        single = ("names", "share", "records")
        joined = {one.name: np.concatenate([getattr(each, one.name) for each in seen])
                  for one in fields(cls) if one.name not in single}  # fmt: skip
        return cls(seen[0].names, **joined, share=float(np.mean([one.share for one in seen])), records=records)

    @classmethod
    def of_rows(
        cls, names: tuple[str, ...], rows: Array, innovation: Array, deviation: Array, *, weight: float = 1.0,
        share: float = 1.0,
    ) -> "Evaluation":  # fmt: skip
        """From whitened rows (n, axes, k + 2): derivatives, the innovation, the logarithm of its deviation, NaN where a
        sample does not count; weight: of each in the sums.
        """
        k = len(names)
        score, information = np.zeros((BLOCKS, k)), np.zeros((BLOCKS, k, k))
        power, logs, count = np.zeros((3, BLOCKS))
        for block, (begin, end) in enumerate(pairwise(np.linspace(0, len(rows), BLOCKS + 1).astype(int))):
            part = rows[begin:end].reshape(-1, k + 2)
            part = part[~np.isnan(part[:, -1])]
            with np.errstate(over="ignore", invalid="ignore"):
                both = part[:, :-1].T @ part[:, :-1]
            # A column is what the innovation gains for one of a parameter: less than the prediction's derivative.
            information[block], score[block], power[block] = both[:-1, :-1], -both[:-1, -1], both[-1, -1]
            logs[block], count[block] = part[:, -1].sum(), len(part)
        return cls(
            names, weight * score, weight * information, weight * power, weight * logs, weight * count,
            innovation, deviation, share,
        )  # fmt: skip

    def shown(self, rows: slice) -> "Evaluation":
        """As far as these samples go; of its sums nothing is meant."""
        return replace(self, innovation=self.innovation[rows], deviation=self.deviation[rows])

    @property
    def sound(self) -> bool:
        """Whether the filter followed the motion to the end."""
        return bool(np.isfinite(self.power).all() and np.isfinite(self.information).all() and self.count.sum() > 0)

    @cached_property
    def scale(self) -> float:
        """Mean square of the whitened innovations: 1 where the noise is as assumed."""
        return float(self.power.sum() / self.count.sum())

    @cached_property
    def log_likelihood(self) -> float:
        """Of the record, concentrated over a common factor on all variances; −∞ for a pass that failed."""
        if not self.sound or not self.scale > 0.0:
            return -np.inf
        n = float(self.count.sum())
        return float(-0.5 * n * (np.log(2.0 * np.pi * self.scale) + 1.0) - self.logs.sum())


@dataclass(frozen=True)
class Check:
    """One check: its name, whether it was passed, what it saw; effect: the one that it concerns, "" for the model."""

    name: str
    passed: bool
    sentence: str
    effect: str = ""


class Layout(ABC):
    """The parameters of a model: where each stands, its prior, its bounds, its unit.

    names (k,); owner (k,) the effect that has it, "" for the base model; mean, deviation (k,) of the prior, scaled;
    least, most (k,) what none goes below or above; factor (k,) SI of a scaled unit; varying: constants that differ
    between records, of which the bench file declares one; tied: by the place of a coefficient the parameter that is the
    same number, (effect, parameter, where its search begins, SI).
    """

    names: tuple[str, ...]
    owner: tuple[str, ...]
    mean: Array
    deviation: Array
    least: Array
    most: Array
    factor: Array
    varying: frozenset[str] = frozenset()
    tied: Mapping[int, tuple[str, str, float]] = MappingProxyType({})

    @property
    def shared(self) -> list[int]:
        """Places of what several records have in common."""
        return list(range(len(self.names)))

    def spread(self, share: float) -> Array:
        """Deviations (k,) of the prior beside a record of whose samples so large a share is independent: that share
        tells how sure a gain is, and is not to move what is most probable.
        """
        return np.asarray(self.deviation / np.sqrt(share))

    def bounded(self, theta: Array) -> Array:
        """Parameters (k,) within their bounds."""
        return np.clip(theta, self.least, self.most)

    def of(self, effect: str) -> list[int]:
        """Places of an effect's parameters."""
        return [k for k, owner in enumerate(self.owner) if owner == effect]

    @property
    def constants(self) -> list[int]:
        """Places of the base model's constants."""
        return self.of("")

    @property
    def has_default(self) -> Sequence[tuple[str, str]]:
        """Searched parameters that need not be searched for: of which effect, and their names."""
        return ()

    @abstractmethod
    def effects_of(self, model: "Model") -> Effects:
        """The effects of a model with their parameters as they are in its theta, SI."""


class ObserverLayout(Layout):
    """A layout on a problem of an observer.

    index (c,) of the first c, constants and coefficients, among the observer's constants; searched: the others,
    parameters of effects that no derivative is written of, each as (effect, parameter); by_difference: places of what
    is searched or tied.
    """

    def __init__(self, problem: Problem, effects: Effects) -> None:
        observer = observer_of(problem, effects, None)
        active = set(observer.active.tolist())
        base = len(observer.model.constants)
        spread = _spreads(observer, problem.settings)
        unsure = [i for i in range(len(observer.names) - observer.states) if i >= base or spread[i] > 0.0]
        free = [i for i in unsure if i not in active]
        self.index = np.array(free, dtype=np.int64)
        self.effects: tuple[Effect, ...] = tuple(effect for _, effect in observer.effects)
        coefficients = [(effect.name, c) for effect in self.effects for c in effect.coefficients]
        self.searched = tuple(
            (e.name, p) for e in self.effects for p in e.parameters if is_searched(p, effects[e.name])
        )
        self.owner = (
            *("" if i < base else coefficients[i - base][0] for i in free), *(name for name, _ in self.searched)
        )  # fmt: skip
        self.names = (
            *(observer.names[observer.states + i] for i in free), *(p.name for _, p in self.searched)
        )  # fmt: skip
        units = [observer.scaling.coefficient(p) for _, p in self.searched]
        values = [effects[name][p.name] / unit for (name, p), unit in zip(self.searched, units, strict=True)]
        self.factor = np.array([*observer.factors[observer.states + self.index], *units])
        self.mean = np.array([*observer.x[observer.states + self.index], *values])
        reach = reach_of(problem)
        known = [spread[i] if i < base else reach * coefficients[i - base][1].plausible for i in free]
        # Where an effect begins is a start, and no measurement.
        begun = [0.0 if i < base else abs(mean) for i, mean in zip(free, self.mean, strict=False)]
        self.deviation = np.array([*np.maximum(known, begun), *(abs(value) for value in values)])
        lowest = [-np.inf if i < base else _lowest(coefficients[i - base][1]) for i in free]
        self.least = np.array([*lowest, *(LEAST * value for value in values)])
        self.most = np.full(len(self.names), np.inf)
        rings = {effect.coefficients[0].name for effect in self.effects if effect.search is Search.RINGS}
        for k in [k for k in range(len(free)) if self.names[k] in rings]:
            # Nearer to the line that was found than to the resonance, or it would be no other mode.
            apart = 0.5 * abs(float(self.mean[k]) - 1.0)
            self.least[k], self.most[k] = self.mean[k] - apart, self.mean[k] + apart
        self.step = observer.h
        self.tied = {
            k: (e.name, p.name, effects[e.name][p.name])
            for k, (owner, name) in enumerate(zip(self.owner, self.names, strict=True))
            for e in self.effects
            for p in e.parameters
            if owner == e.name and name_of(p, "found_as") == kind(name)
        }
        self.by_difference = (*self.tied, *range(len(free), len(self.names)))

    def bounded(self, theta: Array) -> Array:
        """... and no friction turns over within less than it slows the mass by from one sample to the next: no record
        tells that, and no flow from sample to sample follows it.
        """
        theta = super().bounded(theta)
        for k, (effect, parameter) in enumerate(self.searched, start=len(self.index)):
            if (parameter.length, parameter.time) == SPEED:
                slowed = self.step * np.abs(theta[[c for c in self.of(effect) if c < len(self.index)]])
                theta[k] = max(theta[k], float(np.max(slowed, initial=0.0)))
        return theta

    @property
    def constants(self) -> list[int]:
        """Places of the base model's constants: not of where a record begins."""
        return [k for k in range(len(self.index)) if not self.owner[k]]

    def effects_of(self, model: "Model") -> Effects:
        """The effects of a model with the searched and the tied parameters as they are in its theta, SI."""
        effects = {name: dict(given) for name, given in model.effects.items()}
        for k, (name, parameter, given) in self.tied.items():
            effects[name][parameter] = max(float(model.theta[k] * self.factor[k]), LEAST * given)
        for k, (name, p) in enumerate(self.searched, start=len(self.index)):
            effects[name][p.name] = float(model.theta[k] * self.factor[k])
        return effects

    @property
    def has_default(self) -> Sequence[tuple[str, str]]:
        """Searched parameters whose declaration has a value."""
        return [(effect, parameter.name) for effect, parameter in self.searched if parameter.default is not None]

    def shifted(self, model: "Model") -> list[tuple["Model", float]]:
        """Models with one parameter shifted, in the order of `by_difference`, and by how much each was."""
        moved = []
        for k in self.by_difference:
            theta, size = model.theta.copy(), self.deviation[k] if k in self.tied else abs(model.theta[k])
            step = SHIFT * float(size)
            theta[k] += step
            moved.append((replace(model, theta=theta), step))
        return moved


def _lowest(coefficient: EffectCoefficient) -> float:
    """Below which a coefficient does not go: one of a sign that physics forbids is none."""
    return max(coefficient.least, 0.0) if coefficient.positive and not coefficient.is_shape else coefficient.least


def reach_of(problem: Problem) -> float:
    """The largest force that drives a record over that of the target's spring at the amplitude, 1 at least: effects of
    what is driven so hard are larger than of what only rings.
    """
    drive = np.abs(problem.record.drive[:, :, 0]) / Scaling.of(problem.device).drive
    return max(1.0, float(np.max(drive, initial=0.0)))


def is_searched(parameter: Parameter, given: Mapping[str, float]) -> bool:
    """Whether a parameter is a number like any other: given for a start, and no choice of a few."""
    return parameter.name in given and not parameter.choices and not name_of(parameter, "found_as")


def _spreads(observer: Observer, settings: ObserverSettings) -> Array:
    """Scaled prior deviations of the base model's constants (all of them)."""
    full = Observer(observer.device, replace(settings, variant=Variant.FULL, gain=Gain.EKF, effects={}))
    return full.initial_deviations[full.states :]


def observer_of(problem: Problem, effects: Effects, noise: Noise | None, tested: Effects | None = None) -> Observer:
    """The filter of a model: of the motion, the sense offsets and the rate."""
    settings = replace(problem.settings, variant=Variant.SENSE, gain=Gain.EKF, effects={**effects, **(tested or {})})
    device = problem.device
    if noise is not None:
        process = replace(settings.process_noise, force=noise.force, rate=noise.rate)
        settings = replace(settings, process_noise=process)
        device = replace(device, noise=tuple(s * f for s, f in zip(device.noise, noise.sense, strict=True)))
    return Observer(device, settings, watched=len(tested or {}), known=True)


@dataclass(frozen=True)
class Size:
    """A coefficient: its name, its SI unit, whether no such effect has a negative one; is_shape: it says how the effect
    is, and not how large; bent: where it is given, a score test takes the derivative there, and no fit begins there.
    """

    name: str
    unit: str
    positive: bool = False
    is_shape: bool = False
    bent: bool = False


class Described(Protocol):
    """What search, checks and report know of an effect; signals: what a pass has to carry for it."""

    @property
    def coefficients(self) -> Sequence[EffectCoefficient | Size]: ...

    @property
    def signals(self) -> Sequence[object]: ...


class Likelihood(Protocol):
    """A record and the model that is held against it: all that fit, score test, search and checks know of either.

    effects: what is declared beside the base model, by name; axes, samples of the record.
    """

    @property
    def effects(self) -> Effects: ...

    @property
    def axes(self) -> int: ...

    @property
    def samples(self) -> int: ...

    @property
    def first(self) -> int:
        """Samples of the beginning that is fitted first."""
        return self.samples

    @property
    def most(self) -> int:
        """Effects that a model may have beside the declared: nobody believes a fifth."""
        return 4

    @property
    def following(self) -> "Likelihood":
        """The same by a filter that does not lose the motion for what a model lacks; itself, where it does not."""
        return self

    def part(self, rows: slice) -> "Likelihood":
        """The same of these samples only."""

    def layout(self, effects: Effects) -> Layout:
        """The parameters of the model with these effects, their priors and units."""

    def effect(self, name: str) -> Described:
        """Declaration of an effect, by its name with a label."""

    def plausible(self, name: str) -> Array:
        """Likely sizes (c,), scaled, of the coefficients of an effect that `evaluate` watches."""

    def begun(self, layout: Layout, theta: Array, name: str, size: Array) -> Array:
        """Where a fit with an effect more begins, from `theta` (k,) and the size (c,) that the score test tells of what
        was tested.
        """

    def declared_noise(self) -> Noise:
        """The noise as it is declared."""

    def at_first(self, layout: Layout, model: Model) -> Model:
        """The model with the noise that a fit begins at."""
        return model

    def quieten(self, layout: Layout, model: Model) -> Model:
        """The model with about the disturbance that makes the record most probable."""
        return model

    def fit_noise(self, layout: Layout, model: Model) -> Model:
        """The model with the noise that makes the record most probable."""
        return model

    def disturbed(self, layout: Layout, model: Model) -> tuple[Model, Model]:
        """The model with the random force that is declared, and with the one that the record asks for."""

    def examined(self, constants: Mapping[str, float], effects: Effects, split: int) -> Examination:
        """What the bench's observer makes of the whole record with these effects.  Raises DivergedError."""

    def above_floor(self, held_out: Evaluation, after: Examination | None) -> float:
        """What a model leaves on the part held out, over the noise floor."""

    def chance(self, held_out: Evaluation) -> float:
        """By how much more than the noise floor noise alone leaves of a part held out, rarely, rms: of many independent
        innovations by nothing.
        """
        return 1.0

    def candidates(self, model: Model, evaluation: Evaluation) -> Effects:
        """Effects that are not in a model, each with its parameters, SI."""

    def evaluate(
        self, layout: Layout, model: Model, *, derivatives: bool = True, tested: Effects | None = None
    ) -> Evaluation:
        """A pass over the record; with `derivatives` by the model's parameters and by the coefficients of effects in
        `tested`, which are zero.
        """

    def likeliest(self, layout: Layout, models: Sequence[Model]) -> Model:
        """The one that makes the record most probable."""
        return max(models, key=lambda one: self.evaluate(layout, one, derivatives=False).log_likelihood)

    def at_level(
        self, layout: Layout, of: Callable[[float], Model], start: float, between: tuple[float, float], close: float
    ) -> Model:
        """Of the models of a level, that next to `start` which makes the record most probable."""

        def likelihood(value: float) -> float:
            return self.evaluate(layout, of(value), derivatives=False).log_likelihood

        return of(level(likelihood, start, between, close))


@dataclass(frozen=True)
class Beginning:
    """What effects count from where a part of a record is looked at: s from the record's start to the part's, and the
    record's first temperature.
    """

    seconds: float = 0.0
    temperature: float | None = None
