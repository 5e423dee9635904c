"""One pass of the filter over a record: innovations, their likelihood, and its derivatives by any parameters."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from estimator.core.following import Portion, Signatures, scan_block
from estimator.core.layout import OUTPUT
from estimator.effects.declaration import Effect, Parameter, name_of
from estimator.effects.search import Search
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array, Scaling
from estimator.settings import Gain, ObserverSettings, Variant
from estimator.side_by_side import stop_if_abandoned
from estimator.trace.examination import Examination
from estimator.trace.problem import Effects, Problem
from estimator.trace.start import begin_moving

BLOCKS = 24
"""Parts of a record whose scores are taken as independent: longer than the memory of any filter that follows."""
JUMP = 4.0
"""Innovations that are larger than so many times the usual power count less, in proportion (Huber)."""
MEDIAN_OF_SQUARE = 0.455
"""Of a standard normal number."""
SHIFT = 1e-5
"""Of a searched parameter, over which the innovations' difference is taken: small beside any curvature."""
SPEED = (1, -1)
"""Powers of length and time in the unit of a velocity."""
START_CYCLES = 3.0
"""What the start of a filter tells depends on how it was begun: it does not count."""


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


def blocks_of(samples: int) -> Iterable[tuple[int, int]]:
    """First and end of each part of so many samples."""
    return pairwise(np.linspace(0, samples, BLOCKS + 1).astype(int).tolist())


@dataclass(frozen=True)
class Sums:
    """What `Evaluation` has of whitened rows, by part of the record."""

    score: Array
    information: Array
    power: Array
    logs: Array
    count: Array

    @classmethod
    def of(cls, parameters: int) -> "Sums":
        """Of nothing yet, for so many parameters."""
        k = parameters
        return cls(
            np.zeros((BLOCKS, k)), np.zeros((BLOCKS, k, k)), np.zeros(BLOCKS), np.zeros(BLOCKS), np.zeros(BLOCKS)
        )

    def add(self, block: int, rows: Array) -> None:
        """Rows (m, k + 2) of a part: derivatives, the innovation, the logarithm of its deviation."""
        with np.errstate(over="ignore", invalid="ignore"):
            both = rows[:, :-1].T @ rows[:, :-1]
        # A column is what the innovation gains for one of a parameter: less than the prediction's derivative.
        self.information[block], self.score[block], self.power[block] = both[:-1, :-1], -both[:-1, -1], both[-1, -1]
        self.logs[block], self.count[block] = rows[:, -1].sum(), len(rows)

    def times(self, share: float) -> "Sums":
        """Those of so large a share of the rows."""
        return Sums(*(share * getattr(self, each.name) for each in fields(self)))


class Layout(ABC):
    """The parameters of a model: where each stands, its prior, its bounds, its unit.

    names (k,); owner (k,) the effect that has it, "" for the base model; mean, deviation (k,) of the prior, scaled;
    least, most (k,) what none goes below or above; factor (k,) SI of a scaled unit; varying: constants that differ
    between records, of which the bench file declares one.
    """

    names: tuple[str, ...]
    owner: tuple[str, ...]
    mean: Array
    deviation: Array
    least: Array
    most: Array
    factor: Array
    varying: frozenset[str] = frozenset()

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
    parameters of effects that no derivative is written of, each as (effect, parameter).
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
        lowest = [-np.inf if i < base else coefficients[i - base][1].least for i in free]
        self.least = np.array([*lowest, *(1e-3 * value for value in values)])
        self.most = np.full(len(self.names), np.inf)
        rings = {effect.coefficients[0].name for effect in self.effects if effect.search is Search.RINGS}
        for k in [k for k in range(len(free)) if self.names[k] in rings]:
            # Nearer to the line that was found than to the resonance, or it would be no other mode.
            apart = 0.5 * abs(float(self.mean[k]) - 1.0)
            self.least[k], self.most[k] = self.mean[k] - apart, self.mean[k] + apart
        self.step = observer.h

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
        """The effects of a model with the searched parameters as they are in its theta, SI."""
        effects = {name: dict(given) for name, given in model.effects.items()}
        for k, (name, p) in enumerate(self.searched, start=len(self.index)):
            effects[name][p.name] = float(model.theta[k] * self.factor[k])
        return effects

    @property
    def has_default(self) -> Sequence[tuple[str, str]]:
        """Searched parameters whose declaration has a value."""
        return [(effect, parameter.name) for effect, parameter in self.searched if parameter.default is not None]

    def shifted(self, model: "Model") -> list[tuple["Model", float]]:
        """Models with one of the searched parameters shifted, in their order, and by how much each was."""
        moved = []
        for k in range(len(self.index), len(self.index) + len(self.searched)):
            theta, step = model.theta.copy(), SHIFT * float(abs(model.theta[k]))
            theta[k] += step
            moved.append((replace(model, theta=theta), step))
        return moved


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


class Coefficient(Protocol):
    """A number that an effect has; positive: no such effect has a negative one; is_shape: it says how the effect is,
    and not how large.
    """

    @property
    def name(self) -> str: ...

    @property
    def unit(self) -> str: ...

    @property
    def positive(self) -> bool: ...

    @property
    def is_shape(self) -> bool: ...


class Described(Protocol):
    """What search, checks and report know of an effect; signals: what a pass has to carry for it."""

    @property
    def coefficients(self) -> Sequence[Coefficient]: ...

    @property
    def signals(self) -> Sequence[object]: ...


class Likelihood(Protocol):
    """A record and the model that is held against it: all that fit, score test, search and checks know of either.

    effects: what is declared beside the base model, by name; axes, samples of the record; first: samples of the
    beginning that is fitted first; most: effects that a model of it may have beside the declared.
    """

    @property
    def effects(self) -> Effects: ...

    @property
    def axes(self) -> int: ...

    @property
    def samples(self) -> int: ...

    @property
    def first(self) -> int: ...

    @property
    def most(self) -> int: ...

    @property
    def following(self) -> "Likelihood":
        """The same by a filter that does not lose the motion for what a model lacks."""

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

    def quieten(self, layout: Layout, model: Model) -> Model:
        """The model with about the disturbance that makes the record most probable."""

    def fit_noise(self, layout: Layout, model: Model) -> Model:
        """The model with the noise that makes the record most probable."""

    def disturbed(self, layout: Layout, model: Model) -> tuple[Model, Model]:
        """The model with the random force that is declared, and with the one that the record asks for."""

    def examined(self, constants: Mapping[str, float], effects: Effects, split: int) -> Examination:
        """What the bench's observer makes of the whole record with these effects.  Raises DivergedError."""

    def above_floor(self, held_out: Evaluation, after: Examination | None) -> float:
        """What a model leaves on the part held out, over the noise floor."""

    def candidates(self, model: Model, evaluation: Evaluation) -> Effects:
        """Effects that are not in a model, each with its parameters, SI."""

    def evaluate(
        self, layout: Layout, model: Model, *, derivatives: bool = True, tested: Effects | None = None
    ) -> Evaluation:
        """A pass over the record; with `derivatives` by the model's parameters and by the coefficients of effects in
        `tested`, which are zero.
        """


@dataclass(frozen=True)
class Beginning:
    """What effects count from where a part of a record is looked at: s from the record's start to the part's, and the
    record's first temperature.
    """

    seconds: float = 0.0
    temperature: float | None = None


AT_THE_START = Beginning()


def evaluate(
    problem: Problem,
    layout: ObserverLayout,
    model: Model,
    beginning: Beginning = AT_THE_START,
    *,
    derivatives: bool = True,
    tested: Effects | None = None,
) -> Evaluation:
    """`Likelihood.evaluate` of a driven gyro or oscillator, by its filter.

    Raises ModelError as `Observer` does.
    """
    one = _Pass(problem, beginning, layout, model, layout.index if derivatives else layout.index[:0], tested or {})
    others = [
        (_Pass(problem, beginning, layout, moved, layout.index[:0], {}), step)
        for moved, step in (layout.shifted(model) if derivatives else ())
    ]
    names = (*(layout.names if derivatives else ()), *one.tested)
    c, sums = len(one.known), Sums.of(len(names))
    for block, (begin, end) in enumerate(blocks_of(len(problem.record))):
        stop_if_abandoned()
        own = one.advance(begin, end)
        shifted = [(other.advance(begin, end)[:, 0] - own[:, -2]) / step for other, step in others]
        sums.add(block, np.column_stack([own[:, :c], *shifted, own[:, c:]]) if shifted else own)
    variance = one.rows["s"][:, : problem.device.axes]
    return Evaluation(
        names, sums.score, sums.information, sums.power, sums.logs, sums.count,
        np.where(one.seen, one.rows["nu"][:, : problem.device.axes] * one.observer.volts, np.nan),
        np.sqrt(np.where(variance > 0.0, variance, np.nan)) * np.abs(one.observer.volts),
    )  # fmt: skip


class _Pass:
    """A filter on its way over a record, with the sensitivities that it follows: of constants that it knows (indices
    `known`), and of the coefficients of effects that it lacks.
    """

    def __init__(
        self,
        problem: Problem,
        beginning: Beginning,
        layout: ObserverLayout,
        model: Model,
        known: NDArray[np.int64],
        tested: Effects,
    ) -> None:
        self.record, self.known = problem.record, known
        self.observer = observer = observer_of(problem, layout.effects_of(model), model.noise, tested)
        observer.x[observer.states + layout.index] = model.theta[: len(layout.index)]
        begin_moving(observer, problem.record)
        observer.begin_at(beginning.seconds, beginning.temperature)
        lacking = observer.effects[observer.carried :]
        self.tested = [effect.name for _, effect in lacking for _ in effect.coefficients]
        record = problem.record
        self.scaled = observer.scaled(record.sense, record.drive, record.step, record.channels.get("temperature"))
        observer.allow_steps(float(np.max(self.scaled[2], initial=observer.h)), self.scaled[1].shape[2] - 1)
        self.rows = np.zeros(len(record), OUTPUT)
        self.delta = np.zeros((observer.states + len(observer.active), len(known) + len(self.tested)))
        self.seen = np.isfinite(record.sense)
        self.skip = int(np.ceil(START_CYCLES * 2.0 * np.pi / observer.h))
        self.level = JUMP

    def advance(self, begin: int, end: int) -> Array:
        """Over one part of the record; whitened rows (m, k + 2) of the innovations that count: sensitivities, the
        innovation, the logarithm of its deviation.
        """
        z, u, h, warmth = self.scaled
        axes, k = self.observer.device.axes, self.delta.shape[1]
        equations = np.zeros((axes * (end - begin), k + 2))
        for start, stop, spread in _pieces(self.record, begin, end):
            part, lines = slice(start, stop), slice(axes * (start - begin), axes * (stop - begin))
            portion = Portion(z[part], u[part], h[part], warmth[part], self.rows[part])
            nowhere: Array = np.zeros((0, k))
            scan_block(
                self.observer,
                portion,
                Signatures(self.delta, self.level, equations[lines], np.zeros(0), nowhere, self.known),
            )
            if spread is not None:
                self.observer.unsettle(spread)
        told = self.seen[begin:end].ravel() & (np.repeat(np.arange(begin, end), axes) >= self.skip)
        counted = equations if told.all() else equations[told]
        usual = _median(counted[:, k] ** 2) / MEDIAN_OF_SQUARE if len(counted) else 1.0
        self.level = JUMP * max(1.0, usual) if np.isfinite(usual) else JUMP
        return counted


def _median(values: Array) -> float:
    """NumPy's own takes ten times as long of a thousand."""
    upper, lower = len(values) // 2, (len(values) - 1) // 2
    sorted_there = np.partition(values, (lower, upper))
    return float(0.5 * (sorted_there[lower] + sorted_there[upper]))


def _pieces(record: Record, begin: int, end: int) -> list[tuple[int, int, Array | None]]:
    """A part of the record cut behind its gaps, each with what the gap at its end adds to the motion's covariance."""
    gaps = None if record.gaps is None else record.gaps.part(slice(begin, end))
    if gaps is None or not len(gaps):
        return [(begin, end, None)]
    cuts: dict[int, Array] = dict(zip((gaps.last + 1).tolist(), gaps.spread, strict=True))
    stops = sorted({*cuts, end - begin})
    return [(begin + a, begin + b, cuts.get(b)) for a, b in pairwise([0, *stops])]
