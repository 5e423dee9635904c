"""Models by their free run: start, constants and coefficients fitted by the error of a run that nothing corrects.

One free run that carries every candidate at zero tells, by its derivatives, how much of the residual each of them would
explain beyond what the parameters so far could; the few that promise most are then fitted in earnest.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator.correlation import effective_samples
from estimator.effects.catalogue import EFFECTS
from estimator.effects.search import Search
from estimator.errors import ModelError
from estimator.free_stretches import FreeRuns
from estimator.identification.problem import Effects, Problem
from estimator.observer import Observer
from estimator.record import Record
from estimator.refinement import Refined, refine
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings
from estimator.side_by_side import side_by_side
from estimator.simulation import simulate
from estimator.thresholds import THRESHOLDS
from estimator.trace.criterion import extended
from estimator.trace.determined import declared, unsettled
from estimator.trace.engine import Estimate, Score, Trial
from estimator.trace.kin import are_kin
from estimator.trace.nested import simpler_than

_SET = THRESHOLDS.free_runs

Rows = slice | NDArray[np.bool_]


@dataclass(frozen=True)
class Promise:
    """What a candidate would explain at first order: gain of twice the log-likelihood, its price, its signature (rows,
    coefficients) beside everything carried.
    """

    gain: float
    price: float
    signature: Array


@dataclass(frozen=True)
class FreeRun:
    """A model: the effects it carries, its observer, the free run that was fitted."""

    effects: tuple[str, ...]
    observer: Observer
    fit: Refined


Promises = Mapping[str, Promise]
Fit = TypeVar("Fit")


@dataclass(frozen=True)
class FreeRunModel:
    """`estimator.trace.engine.Model` by free runs over the record of `problem`: fitted to the rows `choice`, while
    `later` must agree; `names` are the candidates; progress: told how many of a round are fitted.
    """

    problem: Problem
    choice: Rows
    later: Rows
    names: tuple[str, ...]
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None

    def promise(self, current: FreeRun, barred: Collection[str]) -> Promises:
        """At first order, by one free run."""
        left = [name for name in self.names if name not in current.effects and name not in barred]
        return promises_of(self.problem, current.effects, left, current.fit, self.choice)

    def hopeful(
        self, look: Promises, tried: Mapping[str, Trial[FreeRun]], refused: Collection[str], number: int
    ) -> Sequence[str]:
        """Those whose promise outweighs its price, the best few.

        Beside a residual far from white, the next term of a law often promises a little more than the first, and what
        comes after it then has no room: it waits for the first.
        """
        worth = (name for name, promise in look.items() if promise.gain > promise.price and not _waits(name, look))
        return sorted(worth, key=lambda name: look[name].price - look[name].gain)[: _SET.tried]

    def fit(
        self, current: FreeRun, look: Promises, names: Sequence[str], tried: Mapping[str, Trial[FreeRun]]
    ) -> Mapping[str, FreeRun | str]:
        """Fitted in earnest, from what `current` found."""
        return each_of(names, partial(self._fit, current), self.progress)

    def _fit(self, current: FreeRun, name: str) -> FreeRun | str:
        try:
            return fitted(self.problem, (*current.effects, name), current.fit, self.choice)
        except ModelError:
            return "no free run with it stays within bounds"

    def score(self, current: FreeRun, look: Promises, fits: Mapping[str, FreeRun]) -> Mapping[str, Score]:
        """Gains counted in independent samples; the price is that of its promise."""
        gains = {name: self._gain(current.fit, trial.fit) for name, trial in fits.items()}
        return {name: Score(gain, gain, look[name].price, look[name].price) for name, gain in gains.items()}

    def _gain(self, current: Refined, trial: Refined) -> float:
        residual = np.ravel(trial.residual[self.choice])
        samples = effective_samples(residual[np.isfinite(residual)])
        return samples * 2.0 * math.log(_rms(current, self.choice) / _rms(trial, self.choice))

    def coefficients(self, fit: FreeRun) -> Mapping[str, Mapping[str, Estimate]]:
        """With intervals that allow for a residual that is not white."""
        return estimates_of(fit.observer, fit.fit)

    def objection(self, current: FreeRun, name: str, trial: Trial[FreeRun]) -> str | None:
        """The part without a vote must be predicted better as well."""
        if _rms(trial.fit.fit, self.later) >= _rms(current.fit, self.later):
            return "fits two thirds of the record better and the other third worse"
        return None


def each_of(
    names: Sequence[str], fit: Callable[[str], Fit], progress: Callable[[str, int, int], None]
) -> dict[str, Fit]:
    """What `fit` makes of each candidate, side by side; progress: told how many of them are done."""
    found = side_by_side([partial(fit, name) for name in names], lambda done: progress("candidates", done, len(names)))
    return dict(zip(names, found, strict=True))


def estimates_of(observer: Observer, fit: Refined) -> Mapping[str, Mapping[str, Estimate]]:
    """The coefficients of all that a free run carries, with their intervals."""
    return {
        effect.name: {
            c.name: Estimate(fit.value(c.name), *fit.interval(c.name), c.positive, c.is_shape, effect.gain)
            for c in effect.coefficients
        }
        for _, effect in observer.effects
    }


def fitted(problem: Problem, effects: tuple[str, ...], current: Refined | None, rows: Rows) -> FreeRun:
    """The free run with these effects, fitted to these rows from what was found so far.

    Raises ModelError where no free run stays within bounds.
    """
    observer, record = _observer(problem, effects), problem.record
    start = _carried_over(observer, current)
    if not np.any(record.drive):
        start = _followed(observer, record, start, current is None)
    free = unsettled(observer)
    refined = refine(
        observer, record.sense, record.drive, start=start, free=free, step=record.step, rows=rows,
        known=declared(observer), stretches=record.stretches,
    )  # fmt: skip
    return FreeRun(effects, observer, refined)


def parts_of(part: Record, skip: int) -> tuple[Rows, Rows]:
    """The rows on which candidates compete, and those that must agree."""
    if np.any(part.drive):
        edge = int(_SET.choice * len(part))
        return slice(skip, edge), slice(edge, len(part))
    agreeing = np.asarray(np.arange(len(part)) // _SET.block % 3 == 2)
    return ~agreeing, agreeing


def candidates(device: Device, settings: ObserverSettings, asked: Collection[str] = ()) -> tuple[str, ...]:
    """Effects that the device can have, that need nothing given (no frequency, no threshold) and can be run freely, of
    those that are tried on request only the ones `asked` for.
    """
    possible = []
    for effect in (*EFFECTS, *device.own):
        name = effect.name
        if effect.declared_only or (effect.on_request and name not in asked):
            continue
        if effect.search is Search.RINGS:
            continue  # a line is looked for first
        if name in settings.effects:
            continue
        try:
            observer = _carrying(device, settings, {name: {}})
            simulate(observer, observer.state, np.zeros((2, device.axes)))
        except ModelError:
            continue
        possible.append(name)
    return tuple(possible)


def _waits(name: str, look: Promises) -> bool:
    """Whether an effect is the next term of a law whose first is a candidate still."""
    first = simpler_than(name)
    return first in look and are_kin(name, first)


def promises_of(
    part: Problem,
    taken: Sequence[str],
    left: Sequence[str],
    current: Refined,
    choice: Rows,
    shown: str | None = None,
) -> Promises:
    """What each candidate would explain of the present residual, by one free run that carries them all at zero.

    shown: a candidate that the record is known to show, however little of its signature is its own.
    """
    observer, record = _observer(part, (*taken, *left)), part.record
    state = _carried_over(observer, current)
    runs = FreeRuns(observer, record.sense, record.drive, record.step, record.stretches)
    simulation = runs.simulate(state, sensitive=True)
    valid = runs.told[choice]
    residual = (record.sense[choice] - simulation.sensed[choice])[valid]
    derivative = simulation.sensitivity[choice][valid]
    carried = [observer.names.index(name) for name in current.free]
    sizes = np.linalg.norm(derivative[:, carried], axis=0)
    there = sizes > 0.0  # of a column of zeros Q has a direction all the same, which would be taken off
    basis = np.linalg.qr(derivative[:, carried][:, there] / sizes[there])[0]
    residual = residual - basis @ (basis.T @ residual)
    power = float(residual @ residual)
    samples = effective_samples(residual)
    found = {}
    for name in left:
        effect = next(effect for _, effect in observer.effects if effect.name == name)
        own = derivative[:, [observer.names.index(c.name) for c in effect.coefficients]]
        rest = own - basis @ (basis.T @ own)
        least = 0.0 if name == shown else _SET.visible
        seen = np.linalg.norm(rest, axis=0) > least * np.linalg.norm(own, axis=0)
        price = extended(own.shape[1], samples, len(left))
        if not seen.any():
            found[name] = Promise(0.0, price, rest[:, seen])
            continue
        q = np.linalg.qr(rest[:, seen] / np.linalg.norm(rest[:, seen], axis=0))[0]
        explained = min(float(np.sum((q.T @ residual) ** 2)), power * (1.0 - 1e-12))
        found[name] = Promise(-samples * math.log1p(-explained / power), price, rest[:, seen])
    return found


def coefficient_names(problem: Problem, name: str) -> set[str]:
    """Names of the coefficients of one effect in the state of a free run."""
    alone = _observer(problem, (name,))
    return {c.name for _, effect in alone.effects for c in effect.coefficients}


def _observer(problem: Problem, effects: Sequence[str]) -> Observer:
    given = {**problem.begun, **problem.settings.effects}
    return _carrying(problem.device, problem.settings, {name: given.get(name, {}) for name in effects})


def _carrying(device: Device, settings: ObserverSettings, effects: Effects) -> Observer:
    carried = {name: dict(given) for name, given in effects.items()}
    return Observer(device, replace(settings, gain=Gain.EKF, effects=carried))


def _carried_over(observer: Observer, current: Refined | None) -> Array:
    """The observer's own initial values with the values found so far in it, of what it carries."""
    state = observer.state.copy()
    if current is not None:
        for name, value in zip(current.names, current.state, strict=True):
            if name in observer.names:
                state[observer.names.index(name)] = value
    return state


def _followed(observer: Observer, record: Record, start: Array, afresh: bool) -> Array:
    """Where to start on a free response, which keeps no phase but its own: fitted to ever longer beginnings.

    Afresh, the constants are those of one pass of the observer.
    """
    if afresh:
        scratch = Observer(observer.device, observer.settings)
        scratch.run(record.sense, record.drive, step=record.step)
        constants = slice(observer.states, None)
        if np.all(np.isfinite(scratch.state)):
            start[constants] = scratch.state[constants]
    length = _SET.beginning
    while length < len(record):
        beginning = record.part(slice(0, length))
        if afresh and length == _SET.beginning:
            motion = observer.names[: observer.states]
            start = refine(
                observer, beginning.sense, beginning.drive, start=start, free=motion, step=beginning.step
            ).state
        start = refine(
            observer, beginning.sense, beginning.drive, start=start, free=unsettled(observer), step=beginning.step,
            runs=_SET.on_the_way,
        ).state  # fmt: skip
        length *= _SET.longer
    return start


def _rms(fit: Refined, rows: Rows) -> float:
    return float(np.sqrt(np.nanmean(fit.residual[rows] ** 2)))
