"""From a record to a diagnosis: fit, search, checks, words."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from estimator.diagnosis import Diagnosis
from estimator.errors import DivergedError
from estimator.identification.ambiguity import exchanged
from estimator.identification.checks import CHECKS, Evidence
from estimator.identification.filtered import Filtered
from estimator.identification.fit import FittedModel, at, climb, finished, settle
from estimator.identification.likelihood import Evaluation, Likelihood
from estimator.identification.result import diagnosis, effects_of
from estimator.identification.search import search, without_effect
from estimator.side_by_side import side_by_side
from estimator.trace.examination import Examination, examine
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
    whole = Filtered(problem)
    searched, fitted = (whole.part(slice(0, min(split, most))) for most in (SEARCHED, REFINED))
    later = whole.part(slice(split, min(whole.samples, split + REFINED)))
    found = search(searched, progress)
    model, groups = exchanged(searched, found.best)
    if fitted.samples > searched.samples:
        model = finished(fitted, settle(fitted, at(fitted, model.layout, model.model)))
    progress("checks", 0, 1)
    before = examine(problem.carrying(effects_of(found.base)), split)
    named = [name for name in model.model.effects if name not in problem.effects]
    try:
        after = examine(problem.carrying(effects_of(model)), split) if named else before
    except DivergedError:
        after, named = before, []
    evidence = _evidence(fitted, later, model, named, after)
    checks = [check for checker in CHECKS for check in checker(evidence)]
    progress("checks", 1, 1)
    return diagnosis(problem, split, found, evidence, checks, groups, before, after)


def _evidence(
    fitted: Likelihood, later: Likelihood, model: FittedModel, named: list[str], after: Examination
) -> Evidence:
    without = dict(zip(named, side_by_side([partial(_without, fitted, model, name) for name in named]), strict=True))

    def over_later(one: FittedModel) -> Evaluation:
        return later.evaluate(one.layout, one.model, derivatives=False)

    quiet = replace(model.model, noise=replace(model.model.noise, force=fitted.declared_noise().force))
    return Evidence(
        fitted, model, without, over_later(model), {name: over_later(one) for name, one in without.items()},
        after.held_out.ratio,
        fitted.evaluate(model.layout, quiet, derivatives=False),
        fitted.evaluate(model.layout, model.model, derivatives=False),
    )  # fmt: skip


def _without(of: Likelihood, model: FittedModel, name: str) -> FittedModel:
    """The model with one effect less, fitted anew at the noise that it has with it: a larger random force would follow
    what the effect explains.
    """
    less = without_effect(of, model, name)
    return climb(of, at(of, less.layout, replace(less.model, noise=model.model.noise)))
