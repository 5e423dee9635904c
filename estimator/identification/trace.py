"""From a record to a diagnosis: fit, search, checks, words."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from estimator.diagnosis import Diagnosis
from estimator.errors import DivergedError
from estimator.identification.ambiguity import Member, exchanged
from estimator.identification.checks import CHECKS, Evidence
from estimator.identification.filtered import Filtered
from estimator.identification.fit import FittedModel, at, finished, fit, maximise, settle
from estimator.identification.free_run import FreeRun
from estimator.identification.likelihood import Evaluation, Likelihood, ObserverLayout
from estimator.identification.result import diagnosis, effects_of
from estimator.identification.search import Search, search, without_effect
from estimator.side_by_side import side_by_side
from estimator.trace.examination import Examination
from estimator.trace.fitness import require_traceable
from estimator.trace.problem import Problem

SEARCHED = 25_000
"""Samples of the fitted part on which effects are chosen: what shows in more only is small."""
REFINED = 100_000
"""... and on which what was chosen is fitted: beyond, coefficients are surer than any model."""

Progress = Callable[[str, int, int], None]


def trace(problem: Problem, *, split: int, progress: Progress = lambda stage, done, total: None) -> Diagnosis:
    """Choose effects on the samples before `split`, score them on the rest.

    The observer of `problem` is the bench's; effects that it carries already stay.

    Raises ModelError for a record that cannot be traced, with what to record instead.
    """
    require_traceable(problem.record, problem.device, split)
    whole = likelihood_of(problem, split)
    later = whole.part(slice(split, min(whole.samples, split + REFINED)))
    chosen = choose(whole.part(slice(0, split)), progress)
    model = chosen.after
    progress("checks", 0, 1)
    before = whole.examined(constants_of(chosen.before), effects_of(chosen.before), split)
    try:
        after = whole.examined(constants_of(model), effects_of(model), split) if chosen.named else before
    except DivergedError:
        after, model = before, chosen.before
    evidence = evidence_of(chosen.of, later, model, after)
    checks = [check for checker in CHECKS for check in checker(evidence)]
    progress("checks", 1, 1)
    return diagnosis(problem, split, chosen.found, evidence, checks, chosen.groups, before, after)


@dataclass(frozen=True)
class Chosen:
    """What was chosen: on how much of the record, by which search; the models before and after, fitted to `of`; what
    may stand in the place of each effect.
    """

    of: Likelihood
    found: Search
    before: FittedModel
    after: FittedModel
    groups: dict[str, list[Member]]

    @property
    def named(self) -> list[str]:
        """The effects that were added."""
        return [name for name in self.after.model.effects if name not in self.before.model.effects]


def choose(of: Likelihood, progress: Progress = lambda stage, done, total: None) -> Chosen:
    """Effects chosen on a beginning of the record and fitted to more of it."""
    searched, fitted = (of.part(slice(0, min(of.samples, most))) for most in (SEARCHED, REFINED))
    found = search(searched.following, progress)
    if searched.following != searched:
        # What a filter is corrected for all the time, a run that nothing corrects may still tell.
        more = search(searched, progress, freed(searched, found.best))
        found = Search(freed(searched, found.base), more.best, (*found.rounds, *more.rounds))
    best, groups = exchanged(searched, found.best)
    before = found.base
    if fitted.samples > searched.samples:
        before, best = (finished(fitted, settle(fitted, at(fitted, one.layout, one.model))) for one in (before, best))
    return Chosen(fitted, found, before, best, groups)


def freed(of: Likelihood, followed: FittedModel) -> FittedModel:
    """A model that was fitted by a filter, by a run that nothing corrects."""
    model = replace(followed.model, noise=replace(followed.model.noise, force=of.declared_noise().force))
    return finished(of, settle(of, at(of, followed.layout, model)))


def likelihood_of(problem: Problem, split: int) -> Likelihood:
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


def constants_of(fitted: FittedModel) -> dict[str, float]:
    """Constants of the base model, SI."""
    layout = fitted.layout
    assert isinstance(layout, ObserverLayout)
    values = fitted.model.theta[: len(layout.index)] * layout.factor[: len(layout.index)]
    return {name: float(v) for name, owner, v in zip(layout.names, layout.owner, values, strict=False) if not owner}


def evidence_of(fitted: Likelihood, later: Likelihood, model: FittedModel, after: Examination | None) -> Evidence:
    """What the checks look at; after: what the bench's observer makes of the record, where that was asked."""
    named = [name for name in model.model.effects if name not in fitted.effects]
    without = dict(zip(named, side_by_side([partial(_without, fitted, model, name) for name in named]), strict=True))

    def over_later(one: FittedModel) -> Evaluation:
        return later.evaluate(one.layout, one.model, derivatives=False)

    held_out = over_later(model)
    quiet, disturbed = (
        model.evaluation if one is model.model else fitted.evaluate(model.layout, one, derivatives=False)
        for one in fitted.disturbed(model.layout, model.model)
    )
    return Evidence(
        fitted, model, without, held_out, {name: over_later(one) for name, one in without.items()},
        later.above_floor(held_out, after), quiet, disturbed,
    )  # fmt: skip


def _without(of: Likelihood, model: FittedModel, name: str) -> FittedModel:
    """The model with one effect less, fitted anew at the noise that it has with it: a larger random force would follow
    what the effect explains.
    """
    less = without_effect(of, model, name)
    return maximise(of, at(of, less.layout, replace(less.model, noise=model.model.noise)))
