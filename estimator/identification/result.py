"""The words of a diagnosis, and the figures behind them."""

from collections.abc import Iterable, Mapping

import numpy as np

from estimator.diagnosis import Classes, Confusable, Diagnosis, Found, Interval, Rejected, Verdict
from estimator.identification.ambiguity import Member
from estimator.identification.checks import Check, Evidence, covariance
from estimator.identification.fit import FittedModel
from estimator.identification.search import Search
from estimator.scaling import Scaling
from estimator.trace.angle import AngleReader
from estimator.trace.axes import equations_on
from estimator.trace.candidates import kind
from estimator.trace.certainty import TWO_SIDED
from estimator.trace.examination import Examination
from estimator.trace.problem import Effects, Problem
from estimator.trace.symmetries import Constants, equivalents

AXES = ("xx", "yy", "xy")
READ = 100_000
"""Samples over which the angle is read with and without an effect."""
OF_THE_REST = ("noise floor", "disturbance")
"""Checks of what a model leaves."""


def effects_of(fitted: FittedModel) -> dict[str, dict[str, float]]:
    """Effects with coefficients and parameters, SI."""
    layout, model = fitted.layout, fitted.model
    effects = {name: dict(given) for name, given in layout.effects_of(model).items()}
    for k, (owner, name) in enumerate(zip(layout.owner, layout.names, strict=True)):
        if owner:
            effects[owner][name.partition(":")[0]] = float(model.theta[k] * layout.factor[k])
    return effects


def verdict_of(named: list[str], checks: list[Check]) -> Verdict:
    """The word for what the checks say."""
    failed = [check for check in checks if not check.passed]
    of_floor = [check for check in failed if check.name in OF_THE_REST]
    if not named:
        return Verdict.UNEXPLAINED if of_floor else Verdict.ADEQUATE
    if not failed:
        return Verdict.EXPLAINED
    return Verdict.UNEXPLAINED if any(check.effect for check in failed) else Verdict.PARTLY


def diagnosis(
    problem: Problem, split: int, found: Search, evidence: Evidence, checks: list[Check],
    groups: Mapping[str, list[Member]], before: Examination, after: Examination,
) -> Diagnosis:  # fmt: skip
    """What a trace answers: the words, and the figures behind them."""
    named = list(evidence.without)
    verdict = verdict_of(named, checks)
    reader = AngleReader(problem.part(slice(0, min(split, READ))))
    carried = effects_of(evidence.model)
    effects = tuple(_found(name, evidence, carried, reader) for name in named)
    reasons = tuple(check.sentence for check in checks if not check.passed or check.name in ("noise floor", "held out"))
    alike = {
        (kind(name), kind(member.name)): Confusable(kind(name), kind(member.name), member.likeness, None, None)
        for name in named
        for member in groups[name]
    }
    alike |= _equivalents(problem, evidence, effects)
    floor = before.held_out.noise_floor
    was, now = (float(np.mean(np.square(one.held_out.innovation_rms) / np.square(floor))) for one in (before, after))
    share = 1.0 - max(now - 1.0, 0.0) / (was - 1.0) if named and was > 1.0 else None
    moved = reader.moved(problem.effects, carried) if named and problem.device.axes == 2 else None
    return Diagnosis(
        verdict=verdict, effects=effects, confusable=tuple(alike.values()),
        rejected=_rejected(problem, found, evidence), findings=before.findings,
        before=before.fitted, after=after.fitted, held_out_before=before.held_out, held_out_after=after.held_out,
        residual_before=before.residual, residual_after=after.residual, split=split, reasons=reasons,
        angle_moved=moved, share=share, left=after.findings if verdict is Verdict.PARTLY else (),
        probabilities=_probabilities(evidence, checks, groups, found),
    ).of_what_is_named()  # fmt: skip


def _found(name: str, evidence: Evidence, carried: Effects, reader: AngleReader) -> Found:
    model, effect = evidence.model, evidence.of.effect(name)
    layout = model.layout
    spread = covariance(model)
    units = {c.name: c.unit for c in effect.coefficients} | {p.name: p.unit for p in effect.parameters}
    places = layout.of(name)
    intervals = {}
    for k in places:
        value = float(model.model.theta[k] * layout.factor[k])
        half = TWO_SIDED * float(np.sqrt(spread[k, k]) * abs(layout.factor[k]))
        name_of_it = layout.names[k]
        intervals[kind(name_of_it)] = Interval(value, value - half, value + half, units[name_of_it])
    own = places[: len(effect.coefficients)]
    in_si = spread[np.ix_(own, own)] * np.outer(layout.factor[own], layout.factor[own])
    return Found(
        name=kind(name), title=effect.title, equation=equations_on(effect, evidence.of.axes), coefficients=intervals,
        evidence=2.0 * (model.objective - evidence.without[name].objective), undone=effect.undone.value,
        angle_bound=reader.bound(carried, name, in_si) if evidence.of.axes == 2 else None,
    )  # fmt: skip


def _equivalents(problem: Problem, evidence: Evidence, effects: tuple[Found, ...]) -> dict[tuple[str, str], Confusable]:
    """What the named effects may be as well because the equations are the same: no record tells those apart."""
    if problem.device.axes != 2 or not effects:
        return {}
    layout, theta = evidence.model.layout, evidence.model.model.theta
    found = {name: float(theta[k] * layout.factor[k]) for k, name in enumerate(layout.names) if not layout.owner[k]}
    device = problem.device
    stiffness = [found.get(f"k{axis}", value) for axis, value in zip(AXES, device.stiffness, strict=True)]
    damping = [found.get(f"d{axis}", value) for axis, value in zip(AXES, device.damping, strict=True)]
    constants = Constants(
        _three(stiffness), _three(damping), device.stiffness, problem.settings.spread.stiffness * device.target
    )
    intervals = {one.name: dict(one.coefficients) for one in effects}
    return {
        (same.effect, same.other): Confusable(same.effect, same.other, 1.0, same.told_by, None, same.angle)
        for same in equivalents(intervals, constants, None)
    }


def _three(values: list[float]) -> tuple[float, float, float]:
    xx, yy, xy = values
    return xx, yy, xy


def _probabilities(
    evidence: Evidence, checks: Iterable[Check], groups: Mapping[str, list[Member]], found: Search
) -> tuple[Classes, ...]:
    """How probable each account of the record is: likelihoods less what their coefficients cost (Schwarz, 1978).

    Something else than the catalogue has is a random force, where a check finds more of it than a complete model may
    leave.
    """
    quiet, disturbed = evidence.quiet, evidence.disturbed
    penalty = 2.0 * float(np.log(quiet.count.sum()))
    left = any(not check.passed and check.name in OF_THE_REST for check in checks)
    other = 2.0 * (disturbed.log_likelihood - quiet.log_likelihood) - penalty if left else -penalty
    if not evidence.without:
        last = found.rounds[-1]
        gains = {kind(score.name): score.robust - penalty for score in reversed(last.table)}
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


def _rejected(problem: Problem, found: Search, evidence: Evidence) -> tuple[Rejected, ...]:
    """Every other kind once: what it would gain beside the model, and a 95 % bound on its coefficients."""
    scaling = Scaling.of(problem.device)
    last = found.rounds[-1]
    alone = {score.name: score.gain for score in found.rounds[0].table}
    fitted = {name: 2.0 * (one.objective - last.base.objective) for name, one in last.fitted}
    named = {kind(name) for name in evidence.without}
    rejected: dict[str, Rejected] = {}
    for score in last.table:
        which = kind(score.name)
        if which in named or which in rejected:
            continue
        bounds = {}
        wider = TWO_SIDED * float(np.sqrt(max(score.scatter, 1.0)))
        of_effect = evidence.of.effect(score.name).coefficients
        for c, size, deviation in zip(of_effect, score.size.tolist(), score.deviation.tolist(), strict=True):
            value, half = size * scaling.coefficient(c), wider * deviation * abs(scaling.coefficient(c))
            bounds[c.name.partition(":")[0]] = Interval(value, value - half, value + half, c.unit)
        reason = f"gains {fitted.get(score.name, score.gain):.4g} in twice the log-likelihood: no more than chance"
        rejected[which] = Rejected(which, reason, bounds, alone.get(score.name), fitted.get(score.name))
    return tuple(rejected.values())
