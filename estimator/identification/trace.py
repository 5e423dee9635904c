"""From a record to a diagnosis: fit, search, checks, words."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from estimator.diagnosis import Classes, Confusable, Diagnosis, Found, Interval, Rejected, Verdict
from estimator.errors import DivergedError
from estimator.identification.ambiguity import Member, exchanged
from estimator.identification.candidates import kind
from estimator.identification.checks import CHECKS, Check, Evidence, covariance
from estimator.identification.filtered import Filtered
from estimator.identification.fit import FittedModel, at, climb, finished, settle
from estimator.identification.likelihood import Evaluation, Likelihood
from estimator.identification.search import Search, search, without_effect
from estimator.scaling import Array
from estimator.side_by_side import side_by_side
from estimator.trace.axes import equations_on
from estimator.trace.examination import Examination, examine
from estimator.trace.fitness import require_traceable
from estimator.trace.problem import Problem

SEARCHED = 25_000
"""Samples of the fitted part on which effects are chosen: what shows in more only is small."""
REFINED = 100_000
"""... and on which what was chosen is fitted: beyond, coefficients are surer than any model."""
TWO_SIDED = 1.96
OF_THE_REST = ("noise floor", "disturbance")
"""Checks of what a model leaves."""

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
    return _diagnosis(problem, split, found, evidence, checks, groups, before, after)


def effects_of(fitted: FittedModel) -> dict[str, dict[str, float]]:
    """Effects with coefficients and parameters, SI."""
    layout, model = fitted.layout, fitted.model
    effects = {name: dict(given) for name, given in layout.effects_of(model).items()}
    for k, (owner, name) in enumerate(zip(layout.owner, layout.names, strict=True)):
        if owner:
            effects[owner][name.partition(":")[0]] = float(model.theta[k] * layout.factor[k])
    return effects


def _evidence(
    fitted: Likelihood, later: Likelihood, model: FittedModel, named: list[str], after: Examination
) -> Evidence:
    without = dict(
        zip(named, side_by_side([partial(_without, fitted, model, name) for name in named]), strict=True)
    )

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


def verdict_of(named: list[str], checks: list[Check]) -> Verdict:
    """The word for what the checks say."""
    failed = [check for check in checks if not check.passed]
    of_floor = [check for check in failed if check.name in OF_THE_REST]
    if not named:
        return Verdict.UNEXPLAINED if of_floor else Verdict.ADEQUATE
    if not failed:
        return Verdict.EXPLAINED
    return Verdict.UNEXPLAINED if any(check.effect for check in failed) else Verdict.PARTLY


def _diagnosis(
    problem: Problem, split: int, found: Search, evidence: Evidence, checks: list[Check],
    groups: Mapping[str, list[Member]], before: Examination, after: Examination,
) -> Diagnosis:  # fmt: skip
    named = list(evidence.without)
    verdict = verdict_of(named, checks)
    spread = covariance(evidence.model)
    effects = tuple(_found(name, evidence, spread) for name in named)
    reasons = tuple(check.sentence for check in checks if not check.passed or check.name in ("noise floor", "held out"))
    alike = tuple(
        Confusable(kind(name), kind(member.name), member.likeness, None, None)
        for name in named
        for member in groups[name]
    )
    floor = before.held_out.noise_floor
    was, now = (float(np.mean(np.square(one.held_out.innovation_rms) / np.square(floor))) for one in (before, after))
    share = 1.0 - max(now - 1.0, 0.0) / (was - 1.0) if named and was > 1.0 else None
    return Diagnosis(
        verdict=verdict, effects=effects, confusable=alike, rejected=_rejected(found, named), findings=before.findings,
        before=before.fitted, after=after.fitted, held_out_before=before.held_out, held_out_after=after.held_out,
        residual_before=before.residual, residual_after=after.residual, split=split, reasons=reasons,
        angle_moved=None, share=share, left=after.findings if verdict is Verdict.PARTLY else (),
        probabilities=_probabilities(evidence, checks, groups, found),
    ).of_what_is_named()  # fmt: skip


def _found(name: str, evidence: Evidence, spread: Array) -> Found:
    model, effect = evidence.model, evidence.of.effect(name)
    layout = model.layout
    units = {c.name: c.unit for c in effect.coefficients} | {p.name: p.unit for p in effect.parameters}
    intervals = {}
    for k in layout.of(name):
        value = float(model.model.theta[k] * layout.factor[k])
        half = TWO_SIDED * float(np.sqrt(spread[k, k])) * abs(float(layout.factor[k]))
        intervals[layout.names[k].partition(":")[0]] = Interval(
            value, value - half, value + half, units[layout.names[k]]
        )
    gain = 2.0 * (model.objective - evidence.without[name].objective)
    return Found(
        name=kind(name), title=effect.title, equation=equations_on(effect, evidence.of.axes),
        coefficients=intervals, evidence=gain, undone=effect.undone.value, angle_bound=None,
    )  # fmt: skip


def _probabilities(
    evidence: Evidence, checks: Iterable[Check], groups: Mapping[str, list[Member]], found: Search
) -> tuple[Classes, ...]:
    """How probable each account of the record is: likelihoods less what their coefficients cost (Schwarz, 1978).

    Something else than the catalogue has is a random force, where a check finds more of it than a complete model may
    leave.
    """
    quiet, disturbed = evidence.quiet, evidence.disturbed
    price = 2.0 * float(np.log(quiet.count.sum()))
    left = any(not check.passed and check.name in OF_THE_REST for check in checks)
    other = 2.0 * (disturbed.log_likelihood - quiet.log_likelihood) - price if left else -price
    if not evidence.without:
        last = found.rounds[-1]
        gains = {kind(score.name): score.robust - price for score in reversed(last.table)}
        return (_classes(None, {"nothing": 0.0, "something else": other, **gains}),)
    classes = []
    for name, without in evidence.without.items():
        gain = evidence.model.gain_over(without)
        weights = {"nothing": 0.0, kind(name): gain, "something else": gain + other}
        weights |= {kind(member.name): gain - member.deficit for member in groups[name]}
        classes.append(_classes(kind(name), weights))
    return tuple(classes)


def _classes(effect: str | None, gains: Mapping[str, float]) -> Classes:
    top = max(gains.values())
    weights = {name: float(np.exp(0.5 * (gain - top))) for name, gain in gains.items()}
    total = sum(weights.values())
    return Classes(effect, dict(sorted(((n, w / total) for n, w in weights.items()), key=lambda item: -item[1])))


def _rejected(found: Search, named: list[str]) -> tuple[Rejected, ...]:
    rejected: dict[str, Rejected] = {}
    first, last = found.rounds[0].table, found.rounds[-1].table
    fitted = {name: 2.0 * (one.objective - found.rounds[-1].base.objective) for name, one in found.rounds[-1].fitted}
    kinds = {kind(name) for name in named}
    for score in last:
        alone = next((one for one in first if one.name == score.name), None)
        which = kind(score.name)
        if which in kinds or which in rejected:
            continue
        rejected[which] = Rejected(
            which, f"gains {fitted.get(score.name, score.gain):.4g} in twice the log-likelihood: less than chance",
            {}, None if alone is None else alone.gain, fitted.get(score.name),
        )  # fmt: skip
    return tuple(rejected.values())
