"""Effects named by the free run: what a simulation that nothing corrects gets wrong over the whole record.

One free run that carries every candidate at zero tells, by its derivatives, how much of the residual each of them would
explain beyond what the parameters so far could; the few that promise most are then fitted in earnest.  Where the motion
is known well and pushed by little else than its drive (circuits, mechanisms, ring-downs), this sees effects that an
observer, corrected at every sample, hides in its innovation.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.effects.catalogue import names as known_names
from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.refinement import Refined, refine
from estimator.residual.effective import effective_samples
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings
from estimator.simulation import simulate
from estimator.trace.problem import Problem
from estimator.trace.record import Record

_MOST = 6  # effects
_TRIED = 3  # candidates that are fitted in earnest, a round
_COMPARED = 24_000  # samples on which candidates are compared
_CHOICE = 2.0 / 3.0  # of those: the rest, which comes after, must agree
_VISIBLE = 0.03  # of a signature, what must be left beside the parameters so far
_BLOCK = 16  # samples
_ON_THE_WAY = 12  # free runs of a fit that only leads to the next
_FIRST = 64  # samples of a free response that are fitted first
_ALIKE = 0.98  # correlation of signatures above which a record does not tell two effects apart

Rows = slice | NDArray[np.bool_]
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Promise:
    """What a candidate would explain at first order: gain of twice the log-likelihood, its price, its signature (rows,
    coefficients) beside everything carried.
    """

    gain: float
    price: float
    signature: Array


@dataclass(frozen=True)
class SimulationTrace:
    """Effects in the order in which they were taken, with evidence (twice the gain of log-likelihood); models before
    and after, fitted to the whole record; reasons of those that were not taken; pairs (taken, not taken) that look
    alike.
    """

    effects: tuple[str, ...]
    evidence: Mapping[str, float]
    observer_before: Observer
    observer: Observer
    before: Refined
    after: Refined
    rejected: Mapping[str, str]
    alike: tuple[tuple[str, str, float], ...]


def trace_by_simulation(problem: Problem, skip: int, progress: Progress) -> SimulationTrace:
    """Name what `problem` lacks on its record, all of which may be used to choose; `skip` samples at its beginning are
    left to the start.

    A candidate is taken when its gain of likelihood on two thirds of the record, counted in independent samples,
    outweighs its coefficients and the number of candidates (extended Bayesian criterion, Chen & Chen, Biometrika 95(3),
    2008) and the other third is predicted better as well: the last one, or every third block of a free response, which
    may have died away by then.  Raises ModelError for a record on
    which the base model has no free run.
    """
    part = problem.part(slice(0, _COMPARED))
    choice, later = _parts(part.record, skip)
    known = tuple(problem.effects)
    observer, current = _fitted(part, known, None, choice)
    names = candidates(problem.device, problem.settings)
    evidence: dict[str, float] = {}
    rejected: dict[str, str] = {}
    taken = list(known)
    promises: dict[str, Promise] = {}
    for number in range(_MOST):
        progress("free runs", number, _MOST)
        left = [name for name in names if name not in taken and name not in rejected]
        promises = promises_of(part, taken, left, current, choice)
        hopeful = sorted(
            (name for name in left if promises[name].gain > promises[name].price),
            key=lambda name: promises[name].price - promises[name].gain,
        )[:_TRIED]
        trials: dict[str, tuple[Observer, Refined]] = {}
        for name in hopeful:
            try:
                trials[name] = _fitted(part, (*taken, name), current, choice)
            except ModelError:
                rejected[name] = "no free run with it stays within bounds"
                continue
            if wrong := unphysical(*trials[name]):
                rejected[name] = f"fits only with a negative {wrong}, which would be something else"
                del trials[name]
        gains = {name: _gain(current, trial, choice) for name, (_, trial) in trials.items()}
        ranked = sorted(trials, key=lambda name: promises[name].price - gains[name])
        chosen = None
        for name in ranked:
            if gains[name] <= promises[name].price:
                continue
            if _rms(trials[name][1], later) >= _rms(current, later):
                rejected[name] = "fits two thirds of the record better and the other third worse"
                continue
            chosen = name
            break
        if chosen is None:
            break
        observer, current = trials[chosen]
        evidence[chosen] = gains[chosen]
        taken.append(chosen)
    for name in names:
        if name not in taken and name not in rejected:
            gain = promises[name].gain if name in promises else 0.0
            rejected[name] = f"evidence {gain:.1f} does not outweigh its coefficients"
    alike = _alike(part, taken, known, names, current, choice)
    progress("refinement", 0, 2)
    whole = slice(skip, None)
    observer_before, before = _fitted(problem, known, None, whole)
    progress("refinement", 1, 2)
    observer, after = (
        _fitted(problem, tuple(taken), current, whole)
        if evidence
        else (
            observer_before,
            before,
        )
    )
    progress("refinement", 2, 2)
    return SimulationTrace(tuple(evidence), evidence, observer_before, observer, before, after, rejected, alike)


def _parts(part: Record, skip: int) -> tuple[Rows, Rows]:
    """The rows on which candidates compete, and those that must agree."""
    if np.any(part.drive):
        edge = int(_CHOICE * len(part))
        return slice(skip, edge), slice(edge, len(part))
    agreeing = np.asarray(np.arange(len(part)) // _BLOCK % 3 == 2)
    return ~agreeing, agreeing


def candidates(device: Device, settings: ObserverSettings) -> tuple[str, ...]:
    """Effects that the device can have, that need nothing given (no frequency, no threshold) and can be run freely."""
    possible = []
    for name in known_names():
        if name in settings.effects:
            continue
        try:
            observer = _observer(device, settings, (name,))
            simulate(observer, observer.state, np.zeros((2, device.axes)))
        except ModelError:
            continue
        possible.append(name)
    return tuple(possible)


def promises_of(
    part: Problem,
    taken: list[str],
    left: list[str],
    current: Refined,
    choice: Rows,
) -> dict[str, Promise]:
    """What each candidate would explain of the present residual, by one free run that carries them all at zero."""
    observer, record = _observer(part.device, part.settings, (*taken, *left)), part.record
    state = _carried_over(observer, current)
    simulation = simulate(observer, state, record.drive, step=record.step, sensitive=True)
    valid = np.isfinite(record.sense[choice])
    residual = (record.sense[choice] - simulation.sensed[choice])[valid]
    derivative = simulation.sensitivity[choice][valid]
    carried = [observer.names.index(name) for name in current.free]
    sizes = np.linalg.norm(derivative[:, carried], axis=0)
    basis = np.linalg.qr(derivative[:, carried] / np.where(sizes > 0.0, sizes, 1.0))[0]
    residual = residual - basis @ (basis.T @ residual)
    power = float(residual @ residual)
    samples = effective_samples(residual)
    found = {}
    for name in left:
        effect = next(effect for _, effect in observer.effects if effect.name == name)
        own = derivative[:, [observer.names.index(c.name) for c in effect.coefficients]]
        rest = own - basis @ (basis.T @ own)
        visible = np.linalg.norm(rest, axis=0) > _VISIBLE * np.linalg.norm(own, axis=0)
        price = own.shape[1] * math.log(samples) + 2.0 * math.log(max(len(left), 1))
        if not visible.any():
            found[name] = Promise(0.0, price, rest[:, visible])
            continue
        q = np.linalg.qr(rest[:, visible] / np.linalg.norm(rest[:, visible], axis=0))[0]
        explained = min(float(np.sum((q.T @ residual) ** 2)), power * (1.0 - 1e-12))
        found[name] = Promise(-samples * math.log1p(-explained / power), price, rest[:, visible])
    return found


def _observer(device: Device, settings: ObserverSettings, effects: tuple[str, ...]) -> Observer:
    carried = {name: dict(settings.effects.get(name, {})) for name in effects}
    return Observer(device, replace(settings, gain=Gain.EKF, effects=carried))


def _carried_over(observer: Observer, current: Refined | None) -> Array:
    """The observer's own guess with the values found so far in it."""
    state = observer.state.copy()
    if current is not None:
        for name, value in zip(current.names, current.state, strict=True):
            state[observer.names.index(name)] = value
    return state


def _fitted(
    problem: Problem,
    effects: tuple[str, ...],
    current: Refined | None,
    rows: Rows,
) -> tuple[Observer, Refined]:
    observer, record = _observer(problem.device, problem.settings, effects), problem.record
    start = _carried_over(observer, current)
    if not np.any(record.drive):
        start = _followed(observer, record, start, current is None)
    return observer, refine(observer, record.sense, record.drive, start=start, step=record.step, rows=rows)


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
    length = _FIRST
    while length < len(record):
        beginning = record.part(slice(0, length))
        if afresh and length == _FIRST:
            motion = observer.names[: observer.states]
            start = refine(
                observer, beginning.sense, beginning.drive, start=start, free=motion, step=beginning.step
            ).state
        start = refine(
            observer, beginning.sense, beginning.drive, start=start, step=beginning.step, runs=_ON_THE_WAY
        ).state
        length *= 3
    return start


def unphysical(observer: Observer, fit: Refined) -> str | None:
    """Name of a coefficient that came out negative beyond doubt though it is declared positive."""
    for _, effect in observer.effects:
        for coefficient in effect.coefficients:
            if coefficient.positive and fit.interval(coefficient.name)[1] < 0.0:
                return coefficient.name
    return None


def _rms(fit: Refined, rows: Rows) -> float:
    return float(np.sqrt(np.nanmean(fit.residual[rows] ** 2)))


def _gain(current: Refined, trial: Refined, rows: Rows) -> float:
    residual = np.ravel(trial.residual[rows])
    samples = effective_samples(residual[np.isfinite(residual)])
    return samples * 2.0 * math.log(_rms(current, rows) / _rms(trial, rows))


def _alike(
    part: Problem,
    taken: list[str],
    known: tuple[str, ...],
    names: tuple[str, ...],
    current: Refined,
    choice: Rows,
) -> tuple[tuple[str, str, float], ...]:
    """Pairs of an effect that was taken and one that was not whose signatures this record does not tell apart."""
    pairs = []
    for name in taken[len(known) :]:
        others = [other for other in taken if other != name]
        alone = _observer(part.device, part.settings, (name,))
        own_names = {c.name for _, effect in alone.effects for c in effect.coefficients}
        reduced = replace(current, free=tuple(free for free in current.free if free not in own_names))
        left = [candidate for candidate in names if candidate not in others]
        signatures = promises_of(part, others, left, reduced, choice)
        own = signatures[name].signature
        for candidate in left:
            if candidate in taken:
                continue
            rest = signatures[candidate].signature
            if own.shape[1] == 0 or rest.shape[1] == 0:
                continue
            correlation = float(np.linalg.norm(np.linalg.qr(own)[0].T @ np.linalg.qr(rest)[0], 2))
            if correlation > _ALIKE:
                pairs.append((name, candidate, correlation))
    return tuple(pairs)
