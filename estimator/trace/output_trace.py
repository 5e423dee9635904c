"""From readings that follow no motion to a diagnosis: the same search, exchange and checks, and what the kind adds."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimator.chance import TWO_SIDED, f_isf
from estimator.correlation import effective_samples
from estimator.diagnosis import Diagnosis, Fit, Found, Interval, Rejected, Residual, Separation, Unconfirmed, Verdict
from estimator.effects.labels import kind
from estimator.scaling import Array
from estimator.side_by_side import one_blas_thread
from estimator.trace.ambiguity import Member
from estimator.trace.checks import CHECKS, RARE, Check, Evidence, covariance
from estimator.trace.chosen import Chosen, choose
from estimator.trace.fit import ROUGH, FittedModel, at, maximise
from estimator.trace.likelihood import Likelihood
from estimator.trace.noise import ljung_box
from estimator.trace.output_error import Output, OutputError, OutputLayout
from estimator.trace.probabilities import probabilities
from estimator.trace.result import verdict_of
from estimator.trace.trace import evidence_of

REFUSED = ("held out", "sign", "limit", "walk")
"""Checks without which an effect is no part of a model; the others may fail for what else is left."""


@dataclass(frozen=True)
class Judged:
    """What was chosen, and what the checks say of it; dropped: effects that a check of their own refused, and why;
    first: what the checks looked at while these were there.
    """

    fitted: OutputError
    later: OutputError
    chosen: Chosen
    evidence: Evidence
    checks: list[Check]
    dropped: Mapping[str, str]
    first: Evidence

    @property
    def layout(self) -> OutputLayout:
        """Of the model."""
        assert isinstance(self.evidence.model.layout, OutputLayout)
        return self.evidence.model.layout


def half_width(model: FittedModel, k: int) -> float:
    """Half-width of the 95 % interval of a parameter, scaled."""
    return TWO_SIDED * float(np.sqrt(max(covariance(model)[k, k], 0.0)))


@one_blas_thread()
def trace_output(output: Output, fitting: NDArray[np.bool_], before: FittedModel | None = None) -> Diagnosis:
    """Choose effects on the readings `fitting`, score them on the others.

    before: the base model that figures are compared with, where it is not the one that is fitted to all of these.
    Raises ModelError for readings of which the base model is none.
    """
    judged = _judged(output, np.flatnonzero(fitting), np.flatnonzero(~fitting))
    return _diagnosis(judged, judged.chosen.before if before is None else before)


def _judged(output: Output, told: NDArray[np.int64], held_out: NDArray[np.int64]) -> Judged:
    """The model of which no effect fails a check of its own: such a one is no part of it."""
    fitted, later = OutputError(output, told, told), OutputError(output, told, held_out)
    chosen = choose(fitted, lambda stage, done, total: None)
    dropped: dict[str, str] = {}
    first: Evidence | None = None
    model = chosen.after
    while True:
        evidence = evidence_of(later, chosen, model, None, None)
        evidence = replace(evidence, chance=_chance(later, evidence))
        assert isinstance(model.layout, OutputLayout)
        checks = [check for checker in CHECKS for check in checker(evidence)]
        checks += output.checks(model.layout, model.model.theta, partial(half_width, model), held_out)
        checks += _walk(chosen.of, evidence)
        # What is not the same in all parts of the record may be what else is left.
        checks = [one if one.name in REFUSED else replace(one, effect="") for one in checks]
        failed = {one.effect: one.sentence for one in checks if one.name in REFUSED and not one.passed}
        if not failed:
            return Judged(fitted, later, chosen, evidence, checks, dropped, first or evidence)
        # One at a time, the least first: beside a superfluous effect another looks weaker than it is.
        least = min(failed, key=lambda name: -evidence.without[name].criterion)
        first, dropped[least] = first or evidence, failed[least]
        model = evidence.without[least]


def _walk(of: Likelihood, evidence: Evidence) -> list[Check]:
    """Each effect pays for itself beside an offset that wanders, as a random walk may take its place."""
    assert isinstance(of, OutputError)

    def beside(model: FittedModel) -> float:
        return maximise(of, at(of, model.layout, of.walking(model.layout, model.model)), ROUGH).criterion

    own = beside(evidence.model) if evidence.without else 0.0
    gains = {name: own - beside(less) for name, less in evidence.without.items()}
    return [
        Check(
            "walk",
            gain > 0.0,
            f"beside a random walk of the output, {kind(name)} gains {gain:.4g} less its price",
            name,
        )
        for name, gain in gains.items()
    ]


def _chance(later: OutputError, evidence: Evidence) -> float:
    """By how much more than the noise floor noise alone may leave of the part held out, rms."""
    left = evidence.held_out.innovation[:, 0]
    worth = effective_samples(left[np.isfinite(left)])
    return float(np.sqrt(f_isf(RARE, worth, min(later.output.floor[1], 1e9))))


def _diagnosis(judged: Judged, base: FittedModel) -> Diagnosis:
    output, evidence = judged.fitted.output, judged.evidence
    told, held_out = judged.fitted.told, judged.later.counted
    was, now = (_left(judged.fitted, one) for one in (base, evidence.model))
    share = _share(was[held_out], now[held_out], output.floor[0])
    verdict = verdict_of(list(evidence.without), judged.checks, share)
    named = [] if verdict is Verdict.UNEXPLAINED else list(evidence.without)
    effects = tuple(_found(output, evidence, name) for name in named)
    separations = [_apart(judged, name, member) for name in named for member in judged.chosen.groups[name]]
    undetermined = []
    for one in effects:
        for other, (told_by, said) in output.same(one.name, one.coefficients).items():
            separations.append(Separation(one.name, other, 1.0, told_by, None))
            undetermined.append(said)
    fits = [_fit(output, left[rows]) for rows in (told, held_out) for left in (was, now)]
    return Diagnosis(
        verdict=verdict, effects=effects, separations=tuple(separations), rejected=_rejected(judged, named),
        findings=(), before=fits[0], after=fits[1], held_out_before=fits[2], held_out_after=fits[3],
        residual_before=_residual(was), residual_after=_residual(now), split=len(told),
        reasons=_reasons(judged, verdict, named, share), share=share if named else None,
        undetermined=tuple(undetermined), unconfirmed=None if named else _unconfirmed(judged, verdict),
        probabilities=probabilities(evidence, judged.checks, _accounts(judged), judged.chosen.found),
        base=_told(output, evidence.model if named else base),
    ).of_what_is_named()  # fmt: skip


def _accounts(judged: Judged) -> dict[str, list[Member]]:
    """The groups less what is a named effect again, with more coefficients: no other account of the record."""
    effect = judged.fitted.effect
    return {
        name: [one for one in members if kind(name) not in effect(one.name).generalises]
        for name, members in judged.chosen.groups.items()
    }


def _share(was: Array, now: Array, floor: float) -> float | None:
    """Of the power above the noise floor, what goes; None where none stood above it."""
    before, after = (float(np.nanmean(left**2)) / floor**2 for left in (was, now))
    return 1.0 - max(after - 1.0, 0.0) / (before - 1.0) if before > 1.0 else None


def _reasons(judged: Judged, verdict: Verdict, named: list[str], share: float | None) -> tuple[str, ...]:
    """Why the verdict is what it is: what is to be said of the base model, then checks that failed."""
    output, model = judged.fitted.output, judged.evidence.model
    reasons = [*output.said(judged.layout, model.model.theta, partial(half_width, model))]
    if verdict is Verdict.PARTLY and share is not None:
        acts = " and ".join(kind(name).replace("_", " ") for name in named)
        reasons.append(f"something acts like {acts}: {share:.1%} of the power above the noise floor goes")
    reasons += [check.sentence for check in judged.checks if not check.passed]
    return (*reasons, *(output.remarks(judged.fitted.told, judged.later.counted) if verdict.is_open else ()))


def _unconfirmed(judged: Judged, verdict: Verdict) -> Unconfirmed | None:
    """The model as it was chosen, where it is none that the checks leave."""
    first, output = judged.first, judged.fitted.output
    if verdict is Verdict.ADEQUATE or not first.without:
        return None
    failed = [check.sentence for check in judged.checks if not check.passed]
    return Unconfirmed(
        tuple(_found(output, first, name) for name in first.without), (*judged.dropped.values(), *failed),
        _fit(output, _left(judged.fitted, first.model)[judged.later.counted]),
    )  # fmt: skip


def _told(output: Output, model: FittedModel) -> dict[str, Interval]:
    """Constants of the base model."""
    assert isinstance(model.layout, OutputLayout)
    places = {name: model.layout.names.index(name) for name in output.base}
    theta = model.model.theta
    return {name: output.interval(model.layout, theta, k, half_width(model, k)) for name, k in places.items()}


def _found(output: Output, evidence: Evidence, name: str) -> Found:
    layout, theta = evidence.model.layout, evidence.model.model.theta
    assert isinstance(layout, OutputLayout)
    effect = output.effect(name)
    return Found(
        kind(name), effect.title, effect.equations,
        {layout.names[k]: output.interval(layout, theta, k, half_width(evidence.model, k)) for k in layout.of(name)},
        2.0 * (evidence.model.objective - evidence.without[name].objective), effect.undone,
    )  # fmt: skip


def _apart(judged: Judged, name: str, member: Member) -> Separation:
    one, other = (judged.fitted.effect(which) for which in (name, member.name))
    told_by = one.look_alikes.get(kind(member.name)) or other.look_alikes.get(kind(name))
    return Separation(kind(name), kind(member.name), member.likeness, told_by, None)


def _rejected(judged: Judged, named: list[str]) -> tuple[Rejected, ...]:
    """Every other kind once, with what it would gain beside the model."""
    last = judged.chosen.found.rounds[-1]
    fitted = {name: 2.0 * (one.objective - last.base.objective) for name, one in last.fitted}
    found = {kind(name): Rejected(kind(name), why) for name, why in judged.dropped.items()}
    for score in last.table:
        gain = fitted.get(score.name, score.gain)
        reason = f"gains {gain:.4g} in twice the log-likelihood: no more than chance"
        if kind(score.name) not in {kind(name) for name in named}:
            found.setdefault(kind(score.name), Rejected(kind(score.name), reason, gain=gain))
    return tuple(found.values())


def _left(fitted: OutputError, model: FittedModel) -> Array:
    """What the readings (n,) are off, in their unit; NaN where what came before the record tells them."""
    every = OutputError(fitted.output, fitted.told, np.arange(len(fitted.output.reading)))
    return np.asarray(every.evaluate(model.layout, model.model, derivatives=False).innovation[:, 0])


def _fit(output: Output, left: Array) -> Fit:
    floor, _, found = output.floor
    left = left[np.isfinite(left)]
    rms = float(np.sqrt(np.mean(left**2)))
    return Fit((rms,), (floor,), rms / floor, ljung_box(left), simulation_rmse=rms, floor_from=found)


def _residual(left: Array) -> Residual:
    nothing: Array = np.zeros(0)
    return Residual(left[:, None], nothing, nothing[:, None])
