"""From several records of one device to one diagnosis: chosen on some of them, judged on the others."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.chance import TWO_SIDED
from estimator.diagnosis import (
    Dependence,
    Diagnosis,
    Fit,
    Found,
    Interval,
    Residual,
    Separation,
    Unconfirmed,
    Verdict,
)
from estimator.effects.labels import kind
from estimator.scaling import Array
from estimator.trace.ambiguity import Member
from estimator.trace.angle import AngleReader
from estimator.trace.checks import Evidence, agreement, deviations
from estimator.trace.chosen import Chosen, choose
from estimator.trace.determined import undetermined
from estimator.trace.examination import Examination
from estimator.trace.fit import FittedModel
from estimator.trace.free_run import FreeRun
from estimator.trace.named import constants_of, effects_of, found_of
from estimator.trace.pairs import pairs_of
from estimator.trace.pool import Pool
from estimator.trace.pooled import Pooled, end_to_end, pooled
from estimator.trace.pooled_layout import PooledLayout, constant_of, of_records
from estimator.trace.probabilities import probabilities
from estimator.trace.rejected import rejected
from estimator.trace.result import READ, Judged, reasons_of
from estimator.trace.trace import judge, likelihood_of

Progress = Callable[[str, int, int], None]


def trace_pool(pool: Pool, held_out: Sequence[int], progress: Progress = lambda stage, done, total: None) -> Diagnosis:
    """Choose effects, and what depends on the covariate, on the records that are not `held_out`; judge on those.

    Raises ModelError for a pool that cannot be divided so, and for a record that cannot be followed.
    """
    fit, judges = pool.divided(held_out)
    hardest = fit.hardest
    whole = pooled(fit, judges, type(likelihood_of(hardest, len(hardest.record))))
    split = whole.fitted_samples
    chosen = choose(whole.part(slice(0, split)), progress)
    progress("checks", 0, 1)
    before = whole.examined(constants_of(chosen.before), effects_of(chosen.before), split)
    judged = judge(whole.problem, whole, chosen, before, split)
    model = judged.evidence.model
    later = whole.part(slice(split, None)).evaluate(model.layout, model.model)
    agree = [*agreement(model, model.evaluation, held_out=False), *agreement(model, later, held_out=True)]
    judged = replace(judged, checks=[*judged.checks, *agree])
    progress("checks", 1, 1)
    return _diagnosis(whole, chosen, judged, before, progress)


def _diagnosis(whole: Pooled, chosen: Chosen, judged: Judged, before: Examination, progress: Progress) -> Diagnosis:
    """The words, and the figures behind them."""
    evidence, checks, after, problem = judged.evidence, judged.checks, judged.after, whole.problem
    model, share, verdict = evidence.model, judged.share, judged.verdict
    carried = of_records(effects_of(model))
    reader = AngleReader(problem.part(slice(0, READ)))
    named = [name for name in judged.named if constant_of(name) is None]
    effects = tuple(_of_device(whole, name, found_of(name, evidence, carried, reader)) for name in named)
    dependences = tuple(_dependence(whole, evidence, name) for name in judged.named if constant_of(name) is not None)
    groups = {name: chosen.groups[name] for name in judged.named}
    others = rejected(evidence.of, problem.device, chosen.found, groups, judged.failed)
    was, now = (_figures(whole, *pair) for pair in ((chosen.before, before), (model, after)))
    unconfirmed = None
    if verdict is Verdict.UNEXPLAINED and judged.named:
        failed = tuple(check.sentence for check in checks if not check.passed)
        unconfirmed = Unconfirmed(effects, failed, now.held_out)
        effects, dependences, groups, share = (), (), {}, None
    experiments = {name: [one for one in groups[name] if constant_of(one.name) is None] for name in named if groups}
    return Diagnosis(
        verdict=verdict, effects=effects,
        separations=(
            *pairs_of(problem, model, experiments, reader, effects, others, progress), *_by_covariate(groups)
        ),
        rejected=others, findings=(),
        before=was.fitted, after=now.fitted, held_out_before=was.held_out, held_out_after=now.held_out,
        residual_before=was.residual, residual_after=now.residual, split=whole.fitted_samples,
        reasons=(*reasons_of(judged, others), *_by_record(whole, evidence)),
        angle_moved=reader.moved(problem.effects, carried) if effects and problem.device.axes == 2 else None,
        share=share, probabilities=probabilities(evidence, checks, chosen.groups, chosen.found),
        undetermined=undetermined(model), unconfirmed=unconfirmed, dependences=dependences,
    ).of_what_is_named()  # fmt: skip


class _Figures(NamedTuple):
    """How well a model predicts the records that were fitted and those held out, and what it leaves of all."""

    fitted: Fit
    held_out: Fit
    residual: Residual


def _figures(whole: Pooled, model: FittedModel, seen: Examination) -> _Figures:
    """As the bench's observer has it; of free runs, what these are off."""
    if not isinstance(whole, FreeRun):
        return _Figures(seen.fitted, seen.held_out, seen.residual)
    split = whole.fitted_samples
    fitted, held_out = (
        whole.part(rows).evaluate(model.layout, model.model, derivatives=False).innovation
        for rows in (slice(0, split), slice(split, None))
    )
    noise = np.asarray(whole.problem.device.noise)
    return _Figures(_fit(fitted, noise), _fit(held_out, noise), end_to_end([fitted, held_out]))


def _fit(left: Array, noise: Array) -> Fit:
    rms = np.sqrt(np.nanmean(left**2, axis=0))
    ratio, whole = float(np.sqrt(np.nanmean((left / noise) ** 2))), float(np.sqrt(np.nanmean(left**2)))
    return Fit(tuple(rms.tolist()), tuple(noise.tolist()), ratio, float("nan"), simulation_rmse=whole)


def _of_device(whole: Pooled, name: str, found: Found) -> Found:
    """An effect less what each record has of its own."""
    own = {kind(c.name) for c in whole.parts[0].of.effect(name).coefficients if c.own}
    return replace(found, coefficients={k: v for k, v in found.coefficients.items() if k not in own})


def _dependence(whole: Pooled, evidence: Evidence, name: str) -> Dependence:
    """A constant or coefficient that goes with the covariate."""
    model, constant = evidence.model, constant_of(name)
    layout = model.layout
    assert isinstance(layout, PooledLayout)
    (slope,) = layout.of(name)
    unit = evidence.of.effect(name).coefficients[0].unit
    middle, changes = (_interval(model, k, unit) for k in (layout.tilted[slope][0], slope))
    gain = 2.0 * (model.objective - evidence.without[name].objective)
    return Dependence(str(constant), str(whole.level.covariate), whole.level.mean, middle, changes, gain)


def _interval(model: FittedModel, k: int, unit: str) -> Interval:
    value = float(model.model.theta[k] * model.layout.factor[k])
    half = TWO_SIDED * float(deviations(model)[k] * abs(model.layout.factor[k]))
    return Interval(value, value - half, value + half, unit)


def _by_covariate(groups: Mapping[str, list[Member]]) -> tuple[Separation, ...]:
    """Pairs of which one is a constant that goes with the covariate: no experiment of one record separates them."""
    return tuple(
        Separation(kind(name), kind(one.name), one.likeness, None, None)
        for name, members in groups.items()
        for one in members
        if constant_of(name) is not None or constant_of(one.name) is not None
    )


def _by_record(whole: Pooled, evidence: Evidence) -> tuple[str, ...]:
    """How far each record that was held out is off, before and after."""
    unit, begin = whole.problem.device.sense_unit, 0
    lines = [f"{len(whole.parts)} records fitted, {len(whole.judges)} held out"]
    way = "a free run of" if isinstance(whole, FreeRun) else "the innovation of"
    later = whole.part(slice(whole.fitted_samples, whole.fitted_samples + len(evidence.held_out.innovation)))
    for part in later.parts:
        rows = slice(begin, begin := begin + part.of.samples)
        was, now = (
            float(np.sqrt(np.nanmean(seen.innovation[rows] ** 2))) for seen in (evidence.before, evidence.held_out)
        )
        where = f", {whole.level.covariate} = {part.covariate:g}," if whole.level.covariate else ""
        before = f", was {was:.3g} {unit}" if evidence.without else ""
        lines.append(f"{way} {part.name}{where} which was held out, is {now:.3g} {unit} rms{before}")
    return tuple(lines)
