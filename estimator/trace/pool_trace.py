"""From several records of one device to one diagnosis: chosen on some of them, judged on the others."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.diagnosis import Dependence, Diagnosis, Fit
from estimator.scaling import Array
from estimator.trace.checks import Evidence, agreement
from estimator.trace.examination import Figures
from estimator.trace.fit import FittedModel
from estimator.trace.free_run import FreeRun
from estimator.trace.pool import Pool
from estimator.trace.pooled import Pooled, pooled
from estimator.trace.pooled_layout import PooledLayout, constant_of
from estimator.trace.problem import Progress, unseen
from estimator.trace.trace import judged_on, likelihood_of
from estimator.trace.verdict import diagnosis


def trace_pool(pool: Pool, held_out: Sequence[int], progress: Progress = unseen) -> Diagnosis:
    """Choose effects, and what depends on the covariate, on the records that are not `held_out`; judge on those.

    Raises ModelError for a pool that cannot be divided so, and for a record that cannot be followed.
    """
    fit, judges = pool.divided(held_out)
    hardest = fit.hardest
    whole = pooled(fit, judges, type(likelihood_of(hardest, len(hardest.record))))
    split = whole.fitted_samples
    chosen, judged, before = judged_on(whole, split, progress)
    model = judged.evidence.model
    later = whole.part(slice(split, None)).evaluate(model.layout, model.model)
    agree = [*agreement(model, model.evaluation, held_out=False), *agreement(model, later, held_out=True)]
    judged = replace(judged, checks=[*judged.checks, *agree])
    goes = tuple(_dependence(whole, judged.evidence, name) for name in judged.named if constant_of(name) is not None)
    figures = _figures(whole, chosen.before, before), _figures(whole, model, judged.after)
    found = diagnosis(whole.problem, split, chosen, judged, figures, progress, goes)
    return replace(found, reasons=(*found.reasons, *_by_record(whole, judged.evidence)))


def _figures(whole: Pooled, model: FittedModel, seen: Figures) -> Figures:
    """As the bench's observer has it; of free runs, what these are off."""
    if not isinstance(whole, FreeRun):
        return seen
    split = whole.fitted_samples
    fitted, held_out = (
        whole.part(rows).evaluate(model.layout, model.model, derivatives=False).innovation
        for rows in (slice(0, split), slice(split, None))
    )
    noise = np.asarray(whole.problem.device.noise)
    return replace(
        seen, fitted=_fit(fitted, noise), held_out=_fit(held_out, noise), residual=np.concatenate([fitted, held_out])
    )


def _fit(left: Array, noise: Array) -> Fit:
    rms = np.sqrt(np.nanmean(left**2, axis=0))
    ratio, whole = float(np.sqrt(np.nanmean((left / noise) ** 2))), float(np.sqrt(np.nanmean(left**2)))
    return Fit(tuple(rms.tolist()), tuple(noise.tolist()), ratio, float("nan"), simulation_rmse=whole)


def _dependence(whole: Pooled, evidence: Evidence, name: str) -> Dependence:
    """A constant or coefficient that goes with the covariate."""
    model, constant = evidence.model, constant_of(name)
    layout = model.layout
    assert isinstance(layout, PooledLayout)
    (slope,) = layout.of(name)
    unit = evidence.of.effect(name).coefficients[0].unit
    middle, changes = (model.interval(k, unit) for k in (layout.tilted[slope][0], slope))
    gain = 2.0 * (model.objective - evidence.without[name].objective)
    return Dependence(str(constant), str(whole.level.covariate), whole.level.mean, middle, changes, gain)


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
