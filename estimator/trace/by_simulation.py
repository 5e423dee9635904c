"""Effects named by the free run: what a simulation that nothing corrects gets wrong over the whole record.

Where the motion is known well and pushed by little else than its drive (circuits, mechanisms, ring-downs), this sees
effects that an observer, corrected at every sample, hides in its innovation.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from estimator.identification.problem import Problem
from estimator.identification.rings import begun
from estimator.observer import Observer
from estimator.refinement import Refined
from estimator.thresholds import THRESHOLDS
from estimator.trace.engine import Dissent, Round, Rules, as_near, choose, why_not
from estimator.trace.free_run_model import (
    FreeRun,
    FreeRunModel,
    Promises,
    candidates,
    coefficient_names,
    fitted,
    parts_of,
    promises_of,
)
from estimator.trace.nested import simpler_by_standing
from estimator.trace.probability import Account, of_rounds

_SET = THRESHOLDS.free_runs

RULES = Rules(most=_SET.most, dissent=Dissent.NEXT, simpler=simpler_by_standing)


Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class SimulationTrace:
    """Effects in the order in which they were taken, with evidence (twice the gain of log-likelihood); models before
    and after, fitted to the whole record; reasons of those that were not taken; pairs (taken, not taken) that look
    alike; how all accounts of each round compare, by who was taken, and of the first where nobody was, by none.
    """

    effects: tuple[str, ...]
    evidence: Mapping[str, float]
    observer_before: Observer
    observer: Observer
    before: Refined
    after: Refined
    rejected: Mapping[str, str]
    alike: tuple[tuple[str, str, float], ...]
    accounts: Mapping[str | None, tuple[Account, ...]] = field(default_factory=dict)


def trace_by_simulation(problem: Problem, skip: int, progress: Progress) -> SimulationTrace:
    """Name what `problem` lacks on its record, all of which may be used to choose; `skip` samples at its beginning are
    left to the start.

    A candidate is taken when its gain of likelihood on two thirds of the record, counted in independent samples,
    outweighs its coefficients and the number of candidates and the other third is predicted better as well: the last
    one, or every third block of a free response, which may have died away by then.  Raises ModelError for a record on
    which the base model has no free run.
    """
    part = problem.part(slice(0, _SET.compared))
    choice, later = parts_of(part.record, skip)
    known = tuple(problem.effects)
    start = fitted(part, known, None, choice)
    part = replace(part, begun=begun(part.device, part.asked, [start.fit.residual]))
    names = (*candidates(part.device, part.settings, part.asked), *(name for name in part.begun if name not in known))
    model = FreeRunModel(part, choice, later, names, progress)
    chosen = choose(model, start, RULES, lambda done, most: progress("free runs", done, most))
    effects = chosen.fit.effects
    rejected = dict(chosen.barred)
    promises = chosen.rounds[min(len(chosen.steps), RULES.most - 1)].look  # of the last round that had a choice
    for name in model.names:
        if name not in effects and name not in rejected:
            rejected[name] = _why(name, promises[name].gain, chosen.rounds)
    alike = _alike(model, chosen.fit, known, as_near(chosen.rounds))
    progress("refinement", 0, 2)
    whole = slice(skip, None)
    before = fitted(problem, known, None, whole)
    progress("refinement", 1, 2)
    after = fitted(problem, effects, chosen.fit.fit, whole) if chosen.steps else before
    progress("refinement", 2, 2)
    return SimulationTrace(
        effects=tuple(chosen.gains),
        evidence=chosen.gains,
        observer_before=before.observer,
        observer=after.observer,
        before=before.fit,
        after=after.fit,
        rejected=rejected,
        alike=alike,
        accounts=of_rounds(chosen.rounds, _promised),
    )


def without(problem: Problem, found: SimulationTrace, names: Collection[str], skip: int) -> SimulationTrace:
    """What was found on the record of `problem` less these effects, the rest fitted anew."""
    kept = {name: gain for name, gain in found.evidence.items() if name not in names}
    observer, after = found.observer_before, found.before
    if kept:
        less = fitted(problem, (*problem.effects, *kept), found.after, slice(skip, None))
        observer, after = less.observer, less.fit
    return replace(found, effects=tuple(kept), evidence=kept, observer=observer, after=after)


def _promised(look: Promises) -> dict[str, float]:
    """In independent samples, at first order."""
    return {name: promise.gain - promise.price for name, promise in look.items()}


def _why(name: str, promised: float, rounds: Sequence[Round[Promises]]) -> str:
    """Why a candidate was not taken, by the last round that fitted it, else by what it promised."""
    return why_not(rounds, name.__eq__) or f"evidence {promised:.1f} does not outweigh its coefficients"


def _alike(
    model: FreeRunModel, found: FreeRun, known: Sequence[str], near: Mapping[str, Collection[str]]
) -> tuple[tuple[str, str, float], ...]:
    """Pairs of an effect that was taken and one that was not which this record does not tell apart, by their signatures
    or, of those that came as near, by their likelihoods; how far the signatures correlate.
    """
    pairs = []
    for name in found.effects[len(known) :]:
        others = [other for other in found.effects if other != name]
        own_names = coefficient_names(model.problem, name)
        reduced = replace(found.fit, free=tuple(free for free in found.fit.free if free not in own_names))
        left = [candidate for candidate in model.names if candidate not in others]
        signatures = promises_of(model.problem, others, left, reduced, model.choice, shown=name)
        own = signatures[name].signature
        for candidate in left:
            if candidate in found.effects:
                continue
            rest = signatures[candidate].signature
            cosines = np.linalg.svd(np.linalg.qr(own)[0].T @ np.linalg.qr(rest)[0], compute_uv=False)
            correlation = float(np.max(cosines, initial=0.0))  # what acts on nothing is like none
            if correlation > _SET.alike or candidate in near.get(name, ()):
                pairs.append((name, candidate, correlation))
    return tuple(pairs)
