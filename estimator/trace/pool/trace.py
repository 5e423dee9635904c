"""The diagnosis of a pool: chosen on some of its records, judged on the others, which nothing was fitted to but where
they begin.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from estimator.diagnosis import (
    Dependence,
    Diagnosis,
    Fit,
    Found,
    Interval,
    Rejected,
    Residual,
    Separation,
    Verdict,
)
from estimator.effects.catalogue import effect_for
from estimator.errors import ModelError
from estimator.identification.axes import equations_on
from estimator.identification.problem import Problem
from estimator.refinement import Refined
from estimator.scaling import Array
from estimator.side_by_side import side_by_side
from estimator.thresholds import THRESHOLDS
from estimator.trace import promises
from estimator.trace.by_simulation import RULES
from estimator.trace.determined import unsettled
from estimator.trace.engine import Chosen, Estimate, as_near, choose, leaves_the_rest, why_not
from estimator.trace.free_run import judged
from estimator.trace.free_run_model import Promises, candidates, parts_of
from estimator.trace.free_run_model import fitted as fitted_alone
from estimator.trace.nameless import Innovations, contest
from estimator.trace.pool.fit import PooledRun, error_on, fitted, observer_of, own_names, shared_names
from estimator.trace.pool.members import Level, Pool, Rows
from estimator.trace.pool.model import PooledModel, constant_of, estimates_of, gain_of
from estimator.trace.probability import of_rounds, stated
from estimator.trace.promises import Claim, Constant, Errors
from estimator.trace.rings import begun as rings_begun

_SET = THRESHOLDS.free_runs
_POOLS = THRESHOLDS.pools

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class _Models:
    """Before and after, fitted to all samples of the records that are fitted; evidence by name of candidate."""

    before: PooledRun
    after: PooledRun
    evidence: dict[str, float]
    why: dict[str, str]


def trace_pool(pool: Pool, held_out: Sequence[int], progress: Progress = lambda stage, done, total: None) -> Diagnosis:
    """Choose effects, and what depends on the covariate, on the records that are not `held_out`; judge on those.

    Raises ModelError for a pool that cannot be divided so, and for a record that has no free run.
    """
    if pool.device.axes != 1:
        raise ModelError("several records at once are traced on a single axis only; trace them one by one")
    fit = pool.of([member for i, member in enumerate(pool.members) if i not in held_out])
    judges = pool.of([pool.members[i] for i in sorted(held_out)])
    if len(fit.members) < _POOLS.fewest or not judges.members:
        raise ModelError(
            f"{len(fit.members)} records to fit and {len(judges.members)} to judge; give {_POOLS.fewest} of the former "
            "and one of the latter at least"
        )
    level = Level.of(fit)
    choice, later, whole = _rows(fit)
    known = tuple(pool.settings.effects)
    begun = _started(fit, level, known, progress)
    first = fitted(fit, known, tuple(begun.slopes), begun, choice)
    fit = replace(fit, begun=rings_begun(pool.device, pool.asked, first.residual))
    names = (*candidates(pool.device, pool.settings, pool.asked), *(name for name in fit.begun if name not in known))
    model = PooledModel(fit, choice, later, names, progress)
    chosen = choose(model, first, RULES, lambda done, most: progress("free runs", done, most))
    progress("refinement", 0, 2)
    models = _refined(fit, known, begun, chosen, whole)
    progress("refinement", 1, 2)
    errors = tuple(error_on(run, judges) for run in (models.before, models.after))
    progress("refinement", 2, 2)
    return _diagnosis(fit, judges, model, chosen, models, errors)


def _rows(pool: Pool) -> tuple[Rows, Rows, Rows]:
    """Of each record the samples on which candidates compete, those that must agree, and all."""
    parts = [parts_of(member.record, 0) for member in pool.members]
    masks: list[list[NDArray[np.bool_]]] = [[], [], []]
    for member, (choice, later) in zip(pool.members, parts, strict=True):
        for kept, rows in zip(masks, (choice, later, slice(None)), strict=True):
            mask = np.zeros(len(member.record), dtype=bool)
            mask[rows] = True
            kept.append(mask)
    choice_masks, later_masks, whole_masks = masks
    return Rows(tuple(choice_masks)), Rows(tuple(later_masks)), Rows(tuple(whole_masks))


def _started(pool: Pool, level: Level, known: tuple[str, ...], progress: Progress) -> PooledRun:
    """Each record by itself: where it begins; of the constants the middle, and how they go with the covariate."""
    observer = observer_of(pool, known)
    own = own_names(observer)
    progress("records by themselves", 0, len(pool.members))
    each = zip(pool.members, pool.problems, strict=True)
    alone = side_by_side(
        [partial(_alone, member.name, one, known) for member, one in each],
        lambda done: progress("records by themselves", done, len(pool.members)),
    )
    names = shared_names(observer)
    shared = {name: float(np.median([fit.value(name) for fit in alone])) for name in names}
    slopes = {}
    if pool.covariate is not None:
        z = np.array([level.scaled(member.covariate) for member in pool.members])
        for name in names:
            line = _line(z, alone, name) if name in unsettled(observer) else None
            if line is not None:
                shared[name], slopes[name] = line
    begins = np.array([[fit.value(name) for name in own] for fit in alone])
    return PooledRun(known, observer, level, begins, shared, slopes, {}, (), {})


def _alone(called: str, problem: Problem, known: tuple[str, ...]) -> Refined:
    try:
        return fitted_alone(problem, known, None, slice(None)).fit
    except ModelError as error:
        raise ModelError(f"{called}: {error}") from None


def _line(z: Array, alone: Sequence[Refined], name: str) -> tuple[float, float] | None:
    """Value at the mean of the covariate and slope of a constant, where chance would not make that slope of the scatter
    of the records about it, nor of what each leaves open; else None.
    """
    values = np.array([fit.value(name) for fit in alone])
    open_to = np.array([fit.deviation[fit.names.index(name)] for fit in alone])
    if not np.all(open_to > 0.0):
        return None  # no record says anything of it: what its values do is rounding
    size = float(np.sum(z**2))
    middle, slope = float(np.mean(values)), float(z @ values) / size
    free = len(z) - 2
    left = open_to * np.abs(z) / size
    doubt = float(np.sqrt(np.sum(left**2)))
    chance = 2.0 * float(norm.sf(abs(slope) / doubt))
    if free > 0:
        scatter = float(np.sqrt(np.sum((values - middle - slope * z) ** 2) / free / size))
        chance = max(chance, 2.0 * float(t.sf(abs(slope) / scatter, free)) if scatter > 0.0 else 0.0)
    return (middle, slope) if chance < THRESHOLDS.criterion.chance else None


def _refined(
    pool: Pool, known: tuple[str, ...], begun: PooledRun, chosen: Chosen[PooledRun, Promises], whole: Rows
) -> _Models:
    """Before, and after less what a guard of its own speaks against and what explains little beside the largest."""
    mean = replace(begun, slopes={})
    before = fitted(pool, known, (), mean, whole)
    after = fitted(pool, chosen.fit.effects, tuple(chosen.fit.slopes), chosen.fit, whole, in_earnest=True)
    why: dict[str, str] = {}
    while True:
        named = {name: one for name, one in estimates_of(after, pool.covariate).items() if name not in known}
        weak = promises.weak(named)
        if not weak:
            break
        name = next(iter(weak))
        why[name] = weak[name]
        after = _without(pool, after, name, whole, in_earnest=True)
    evidence = dict(chosen.gains)
    named = {name: one for name, one in estimates_of(after, pool.covariate).items() if name not in known}
    for name in named:
        if name not in evidence:
            evidence[name] = gain_of(_without(pool, after, name, whole), after, whole)
    return _Models(before, after, {name: evidence[name] for name in named}, why)


def _without(pool: Pool, run: PooledRun, name: str, whole: Rows, *, in_earnest: bool = False) -> PooledRun:
    """The run less a candidate, the rest fitted anew."""
    constant = constant_of(name)
    effects = tuple(one for one in run.effects if one != name)
    gone = set() if constant else {c.name for c in effect_for(name, pool.device.axes, pool.device.own)[1].coefficients}
    slopes = tuple(one for one in run.slopes if one != constant and one not in gone)
    return fitted(pool, effects, slopes, run, whole, in_earnest=in_earnest)


def _diagnosis(
    pool: Pool,
    judges: Pool,
    model: PooledModel,
    chosen: Chosen[PooledRun, Promises],
    models: _Models,
    errors: tuple[tuple[Array, ...], ...],
) -> Diagnosis:
    device, before, after = pool.device, models.before, models.after
    named = tuple(models.evidence)
    off = [float(np.sqrt(np.nanmean(np.concatenate(each) ** 2))) for each in errors]
    noise = float(device.noise[0])
    samples = [np.concatenate([*run.residual, *each]) for run, each in zip((before, after), errors, strict=True)]
    split = sum(len(member.record) for member in pool.members)
    deviation = np.broadcast_to(np.array(device.noise), samples[0].shape)
    was, now = (Innovations(each, deviation, slice(0, split)) for each in samples)
    estimates = estimates_of(after, pool.covariate)
    claim = Claim(
        residual=Errors(off[0], off[1], noise, float(sum(np.sum(np.isfinite(each)) for each in errors[1]))),
        effects={name: estimates[name] for name in named},
        constants=_constants(after),
        contest=contest(was, now, split),
    )
    verdict, against = judged(claim)
    said = named if verdict in (Verdict.EXPLAINED, Verdict.PARTLY) else ()
    why = dict(models.why) | {name: leaves_the_rest(models.evidence[name]) for name in named if name not in said}
    fits = [_fit(run.residual, noise) for run in (before, after)]
    held = [_fit(each, noise) for each in errors]
    nothing: Array = np.zeros(0)
    residuals = [Residual(each, nothing, np.zeros((0, 1))) for each in samples]
    rejected = {name: reason for name, reason in chosen.barred.items() if name not in named} | why
    last = chosen.rounds[-1].look
    for name, promise in last.items():
        if name not in named and name not in rejected:
            plain = f"evidence {promise.gain:.1f} does not outweigh its coefficients"
            rejected[name] = why_not(chosen.rounds, name.__eq__) or plain
    return Diagnosis(
        verdict=verdict,
        effects=tuple(_found(name, models, pool) for name in said if constant_of(name) is None),
        separations=_alike(
            model, after, tuple(name for name in said if constant_of(name) is None), as_near(chosen.rounds)
        ),
        rejected=tuple(Rejected(name, reason) for name, reason in rejected.items()),
        findings=(),
        before=fits[0],
        after=fits[1],
        held_out_before=held[0],
        held_out_after=held[1],
        residual_before=residuals[0],
        residual_after=residuals[1],
        split=split,
        reasons=(
            *_summary(pool, judges, errors, noise, said), *(against if said else promises.not_named(named, against))
        ),
        share=claim.residual.share if said else None,
        probabilities=stated(
            of_rounds(chosen.rounds, _promised), {n: n for n in said}, set(why) - set(said), claim.contest,
            is_open=verdict.is_open,
        ),
        dependences=tuple(
            _dependence(name, models, pool) for name in said if constant_of(name) is not None
        ),
    ).of_what_is_named()  # fmt: skip


def _promised(look: Promises) -> dict[str, float]:
    return {name: promise.gain - promise.price for name, promise in look.items()}


def _constants(run: PooledRun) -> tuple[Constant, ...]:
    """Those of the base model, where the covariate is at its mean, beside what is declared."""
    base = run.observer.model.names
    return tuple(
        Constant(name, *_three(run.estimate(name)), one.value, one.deviation, positive=promises.is_positive(name))
        for name, one in run.known.items()
        if name in base
        # What goes with the covariate is declared for one value of it only.
        and name not in run.slopes
    )


def _three(one: Estimate) -> tuple[float, float, float]:
    return one.value, one.low, one.high


def _fit(residual: Sequence[Array], noise: float) -> Fit:
    rms = float(np.sqrt(np.nanmean(np.concatenate(residual) ** 2)))
    return Fit((rms,), (noise,), rms / noise, float("nan"), simulation_rmse=rms)


def _found(name: str, models: _Models, pool: Pool) -> Found:
    _, effect = effect_for(name, pool.device.axes, pool.device.own)
    run = models.after
    return Found(
        name=name,
        title=effect.title,
        equation=equations_on(effect, pool.device.axes),
        coefficients={
            c.name: Interval(*_three(run.estimate(c.name)), c.unit) for c in effect.coefficients if not c.own
        },
        evidence=models.evidence[name],
        undone=effect.undone.value,
    )


def _dependence(name: str, models: _Models, pool: Pool) -> Dependence:
    run, constant = models.after, constant_of(name)
    assert constant is not None  # asked of those only
    units = {c.name: c.unit for _, effect in run.observer.effects for c in effect.coefficients}
    units |= {item.name: item.quantity.value for item in run.observer.model.constants}
    unit, covariate = units[constant], pool.covariate or ""
    return Dependence(
        constant,
        covariate,
        run.level.mean,
        Interval(*_three(run.estimate(constant)), unit),
        Interval(*_three(run.slope(constant)), unit),
        models.evidence[name],
    )


def _alike(
    model: PooledModel, run: PooledRun, named: tuple[str, ...], near: Mapping[str, Collection[str]]
) -> tuple[Separation, ...]:
    """Pairs of an effect that is named and one that is not which these records do not tell apart, by their signatures
    or, of those that came as near, by their likelihoods.
    """
    pairs = []
    for name in named:
        own = {c.name for c in effect_for(name, model.pool.device.axes, model.pool.device.own)[1].coefficients}
        others = tuple(other for other in run.effects if other != name)
        observer = observer_of(model.pool, others)
        shared = {each: value for each, value in run.shared.items() if each not in own}
        slopes = {each: value for each, value in run.slopes.items() if each not in own}
        apart = run.own_of(own_names(observer), {})
        reduced = replace(run, effects=others, observer=observer, own=apart, shared=shared, slopes=slopes)
        left = [each for each in model.names if each not in others]
        held = {each: run.shared[each] for each in own if each in run.shared}
        look = model.promised(reduced, left, shown=name, held=held)
        mine = look[name].signature
        for other in left:
            theirs = look[other].signature
            if other == name or not mine.shape[1] or not theirs.shape[1]:
                continue
            likeness = float(np.linalg.norm(np.linalg.qr(mine)[0].T @ np.linalg.qr(theirs)[0], 2))
            if likeness > _SET.alike or other in near.get(name, ()):
                pairs.append(Separation(name, other, likeness, None, None))
    return tuple(pairs)


def _summary(
    pool: Pool, judges: Pool, errors: tuple[tuple[Array, ...], ...], noise: float, said: tuple[str, ...]
) -> tuple[str, ...]:
    unit = pool.device.sense_unit
    counts = f"{len(pool.members)} records fitted, {len(judges.members)} held out but for where they begin"
    lines = [f"{counts}; the declared noise is {noise:.3g} {unit}"]
    for member, was, now in zip(judges.members, *errors, strict=True):
        rms = [float(np.sqrt(np.nanmean(each**2))) for each in (was, now)]
        where = f", {pool.covariate} = {member.covariate:g}," if pool.covariate else ""
        before = f", was {rms[0]:.3g} {unit}" if said else ""
        lines.append(f"a free run of {member.name}{where} which was held out, is {rms[1]:.3g} {unit} rms off{before}")
    return tuple(lines)
