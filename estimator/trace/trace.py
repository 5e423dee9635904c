"""From a record to a diagnosis: fit, search, checks, words."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from estimator.diagnosis import Diagnosis, Verdict
from estimator.errors import DivergedError
from estimator.side_by_side import side_by_side, together
from estimator.trace.checks import CHECKS, Evidence
from estimator.trace.chosen import REFINED, SEARCHED, Chosen, choose
from estimator.trace.examination import Examination, examine
from estimator.trace.filtered import Filtered
from estimator.trace.fit import RISE, FittedModel, finished, fit, maximise, settle
from estimator.trace.free_run import FreeRun
from estimator.trace.likelihood import Evaluation, Likelihood
from estimator.trace.named import constants_of, effects_of
from estimator.trace.problem import Problem, Progress, unseen
from estimator.trace.reference import departures
from estimator.trace.rejected import Failed
from estimator.trace.search import without_effect
from estimator.trace.traceable import require_traceable
from estimator.trace.verdict import Judged, diagnosis, share_of

CLOSE = 0.01
"""Share of what an effect gains, to which the model without it is fitted."""


def trace(problem: Problem, *, split: int, progress: Progress = unseen) -> Diagnosis:
    """Choose effects on the samples before `split`, score them on the rest.

    The observer of `problem` is the bench's; effects that it carries already stay.

    Raises ModelError for a record that cannot be traced, with what to record instead.
    """
    require_traceable(problem.record, problem.device, split)
    chosen, judged, before = judged_on(likelihood_of(problem, split), split, progress)
    return diagnosis(problem, split, chosen, judged, (before, judged.after), progress)


def judged_on(whole: Filtered, split: int, progress: Progress = unseen) -> tuple[Chosen, Judged, Examination]:
    """What is chosen on the samples before `split`, what the checks say of it on the rest, and what the bench's
    observer made of the record before.
    """
    chosen_of_it = partial(choose, whole.part(slice(0, split)), progress)
    if type(whole) is Filtered:  # the bench's observer finds the constants itself, and waits for nobody's
        before, chosen = together(lambda: examine(whole.problem, split), chosen_of_it)
    else:
        chosen = chosen_of_it()
        before = whole.examined(constants_of(chosen.before), effects_of(chosen.before), split)
    progress("checks", 0, 1)
    judged = judge(chosen, partial(judged_of, whole, chosen, before, split))
    progress("checks", 1, 1)
    return chosen, judged, before


def judge(chosen: Chosen, of: Callable[[FittedModel], Judged]) -> Judged:
    """The chosen model and what the checks say of it, less effects that a check rejects where the others then stand;
    of: what they say of a model.

    Where the others do not stand, the model as it was chosen is the best candidate.
    """
    first = now = of(chosen.after)
    failed: dict[str, Failed] = {}
    while rejected := {check.effect: check.sentence for check in now.checks if check.effect and not check.passed}:
        without, model = now.evidence.without, now.evidence.model
        name = min(rejected, key=lambda effect: model.gain_over(without[effect]))
        failed[name] = Failed(rejected[name], model)
        less = chosen.before if len(without) == 1 else finished(chosen.of, settle(chosen.of, without[name]))
        now = replace(of(less), failed=dict(failed))
    return first if now.verdict is Verdict.UNEXPLAINED else now


def judged_of(whole: Filtered, chosen: Chosen, before: Examination, split: int, model: FittedModel) -> Judged:
    """A model on the part held out, and what the checks say of it."""
    later, after = whole.part(slice(split, min(whole.samples, split + REFINED))), before
    if model.model.effects != chosen.before.model.effects:
        try:
            after = whole.examined(constants_of(model), effects_of(model), split)
        except DivergedError:
            model = chosen.before
    evidence = evidence_of(later, chosen, model, before, after)
    if whole.axes == 2 and after is not before:
        evidence = replace(evidence, references=tuple(departures(whole.problem, before, after, split)))
    share = share_of(evidence.before_ratio, evidence.floor_ratio) if evidence.without else None
    return Judged(evidence, [check for checker in CHECKS for check in checker(evidence)], after, share, {})


def likelihood_of(problem: Problem, split: int) -> Filtered:
    """The free run of a single axis, and of a response that nothing drives where it errs by less than a filter does
    from one sample to the next; else the filter.
    """
    filtered, free = Filtered(problem), FreeRun(problem)
    if problem.device.axes == 1:
        return free
    if np.any(problem.record.drive):
        return filtered
    errors = [fit(of.part(slice(0, min(split, SEARCHED))), of.effects).evaluation.innovation for of in (filtered, free)]
    return free if np.nanmean(errors[1] ** 2) < np.nanmean(errors[0] ** 2) else filtered


def evidence_of(
    later: Likelihood, chosen: Chosen, model: FittedModel, before: Examination | None, after: Examination | None
) -> Evidence:
    """What the checks look at; before, after: what the bench's observer makes of the record, where that was asked."""
    fitted = chosen.of
    named = [name for name in model.model.effects if name not in fitted.effects]
    without = dict(zip(named, side_by_side([partial(_without, fitted, model, name) for name in named]), strict=True))

    def over_later(one: FittedModel) -> Evaluation:
        return later.evaluate(one.layout, one.model, derivatives=False)

    held_out, lacking = over_later(model), over_later(chosen.before)
    quiet, disturbed = (
        model.evaluation if one is model.model else fitted.evaluate(model.layout, one, derivatives=False)
        for one in fitted.disturbed(model.layout, model.model)
    )
    return Evidence(
        fitted, model, without, held_out, {name: over_later(one) for name, one in without.items()},
        later.above_floor(held_out, after), quiet, disturbed, lacking, later.above_floor(lacking, before),
        chance=later.chance(held_out),
    )  # fmt: skip


def _without(of: Likelihood, model: FittedModel, name: str) -> FittedModel:
    """The model with one effect less, fitted anew at the noise that it has with it: a larger random force would follow
    what the effect explains.  To within a small share of what the effect gains: a model that is out of the question has
    a likelihood with no top near by.
    """
    start = without_effect(of, model, name)
    return maximise(of, start, rise=max(RISE, CLOSE * (model.objective - start.objective)))
