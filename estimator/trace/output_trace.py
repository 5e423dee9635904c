"""From readings that follow no motion to a diagnosis: the same search, exchange and checks, and what the kind adds."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis import Diagnosis, Fit, Found, Interval, Separation, Verdict
from estimator.effects.labels import kind
from estimator.residual.whiteness import portmanteau
from estimator.scaling import Array
from estimator.side_by_side import one_blas_thread
from estimator.trace.ambiguity import Member
from estimator.trace.checks import CHECKS, Evidence
from estimator.trace.chosen import choose
from estimator.trace.examination import Figures
from estimator.trace.fit import ROUGH, FittedModel, at, maximise
from estimator.trace.likelihood import Check
from estimator.trace.output_error import OutputError
from estimator.trace.probabilities import probabilities
from estimator.trace.rejected import Failed, rejected, ruled_out
from estimator.trace.trace import evidence_of, judge
from estimator.trace.verdict import Judged, answer, share_of

LAGS = 20
"""Over which what is left is asked whether it is white."""
REFUSED = ("held out", "sign", "limit", "walk")
"""Checks without which an effect is no part of a model; the others may fail for what else is left."""


@one_blas_thread()
def trace_output(of: OutputError, fitting: NDArray[np.bool_], base: FittedModel | None = None) -> Diagnosis:
    """Choose effects on the readings `fitting`, those of `of`, score them on the others.

    base: the base model that figures are compared with, where it is not the one that is fitted to all of these.
    Raises ModelError for readings of which the base model is none.
    """
    later = replace(of, counted=np.flatnonzero(~fitting))
    chosen = choose(of)
    base = chosen.before if base is None else base
    before = _figures(later, base)

    def judged_of(model: FittedModel) -> Judged:
        evidence, after = evidence_of(later, chosen, model, None, None), _figures(later, model)
        share = share_of(before.held_out.ratio, after.held_out.ratio) if evidence.without else None
        return Judged(evidence, _checks(of, evidence, later), after, share, {})

    judged = judge(chosen, judged_of)
    evidence, model, names = judged.evidence, judged.evidence.model, judged.named
    given = answer(judged, (before, judged.after), tuple(_found(of, evidence, name) for name in names))
    named = names if given.effects else []
    groups = {name: chosen.groups[name] for name in names}
    same = [(one.name, *pair) for one in given.effects for pair in of.same(one.name, one.coefficients).items()]
    separations = (
        *(_apart(of, name, member) for name in named for member in groups[name]),
        *(Separation(name, other, 1.0, by, None) for name, other, (by, _) in same),
    )
    # A check that refused an effect says so, whether or not the others stand without it.
    against = {one.effect: Failed(one.sentence, model) for one in judged.checks if one.effect and not one.passed}
    # What is a named effect again, with more coefficients, is no other account of the record.
    accounts = {
        name: [one for one in members if kind(name) not in of.effect(one.name).generalises]
        for name, members in chosen.groups.items()
    }
    others = rejected(of, chosen.found, groups, {**against, **judged.failed})
    return replace(
        given, separations=separations, rejected=ruled_out(others, separations), split=of.samples,
        reasons=_reasons(later, judged, given),
        undetermined=tuple(said for _, _, (_, said) in same),
        probabilities=probabilities(evidence, judged.checks, accounts, chosen.found),
        base=_intervals(of, model if named else base, [base.layout.names.index(name) for name in of.base]),
    )  # fmt: skip


def _checks(of: OutputError, evidence: Evidence, later: OutputError) -> list[Check]:
    """Those of all kinds of records, of this one, and of a walk."""
    model = evidence.model
    checks = [check for checker in CHECKS for check in checker(evidence)]
    checks += later.checks(model)
    checks += _walk(of, evidence)
    # What is not the same in all parts of the record may be what else is left.
    return [one if one.name in REFUSED else replace(one, effect="") for one in checks]


def _walk(of: OutputError, evidence: Evidence) -> list[Check]:
    """Each effect pays for itself beside an offset that wanders, as a random walk may take its place."""

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


def _reasons(later: OutputError, judged: Judged, given: Diagnosis) -> tuple[str, ...]:
    """Why the verdict is what it is: what is to be said of the base model, then checks that failed."""
    model = judged.evidence.model
    reasons = [*later.said(model)]
    if given.verdict is Verdict.PARTLY and given.share is not None:
        acts = " and ".join(kind(name).replace("_", " ") for name in judged.named)
        reasons.append(f"something acts like {acts}: {given.share:.1%} of the power above the noise floor goes")
    return (*reasons, *judged.against, *(later.remarks() if given.verdict.is_open else ()))


def _intervals(of: OutputError, model: FittedModel, places: list[int]) -> dict[str, Interval]:
    return {model.layout.names[k]: of.interval(model, k) for k in places}


def _found(of: OutputError, evidence: Evidence, name: str) -> Found:
    effect, model = of.effect(name), evidence.model
    return Found(
        kind(name), effect.title, effect.equations, _intervals(of, model, model.layout.of(name)),
        2.0 * (model.objective - evidence.without[name].objective), effect.compensation,
    )  # fmt: skip


def _apart(of: OutputError, name: str, member: Member) -> Separation:
    one, other = of.effect(name), of.effect(member.name)
    told_by = one.look_alikes.get(kind(member.name)) or other.look_alikes.get(kind(name))
    return Separation(kind(name), kind(member.name), member.likeness, told_by, None)


def _figures(later: OutputError, model: FittedModel) -> Figures:
    """What the readings (n,) are off, in their unit; NaN where what came before the record tells them."""
    every = replace(later, counted=np.arange(len(later.reading)))
    left = np.asarray(every.evaluate(model.layout, model.model, derivatives=False).innovation[:, 0])
    fitted, held_out = (_fit(later, left[rows]) for rows in (later.told, later.counted))
    return Figures(fitted, held_out, (), left[:, None])


def _fit(of: OutputError, left: Array) -> Fit:
    floor, _, found = of.floor
    left = left[np.isfinite(left)]
    rms = float(np.sqrt(np.mean(left**2)))
    white = portmanteau(left, max(min(LAGS, len(left) // 4), 1)).p if rms > 0.0 else 1.0
    return Fit((rms,), (floor,), rms / floor, white, simulation_rmse=rms, floor_from=found)
