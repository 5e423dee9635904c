"""What a fitted model has to stand before it is believed: a list of checks, each a name, a result and a sentence.

A check looks at one thing and has one threshold.  None of them knows the others.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator.chance import TWO_SIDED, chi2_isf
from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS
from estimator.trace.fit import PRIOR, FittedModel, beside
from estimator.trace.likelihood import AT_FLOOR, RARE, Check, Evaluation, Likelihood
from estimator.trace.noise import MEDIAN_OF_SQUARE
from estimator.trace.reference import Departure
from estimator.trace.search import FORBIDDEN
from estimator.written import gains, plus_minus, significant

OF_THE_REST = ("noise floor", "disturbance", "outliers")
"""Checks of what a model leaves."""
RMS_OVER_MEDIAN = 0.86
"""Variance, times samples, of the logarithm of the rms of normal numbers over what their median tells of it."""
SMALL = 1e-6
"""Of what is known beforehand, or of what a record says of its constants: what it says less of counts for nothing."""
DISTURBANCE = THRESHOLDS.criterion.disturbance
"""Share of the innovation's power that a random force may explain beside a complete model."""


@dataclass(frozen=True)
class Evidence:
    """What the checks look at.

    model: fitted; without: the same with each of its effects left out, fitted anew; held_out, held_out_without: passes
    of these over the part held out; floor_ratio: innovation over the noise floor there, as the bench's own observer has
    it with this model; quiet, disturbed: passes over the fitted part with the random force that is declared, and with
    the one that the record asks for; before, before_ratio: over the part held out, of the model that has none of them;
    references: errors against a rate reference, where there is one; chance: by how much more than the noise floor noise
    alone leaves, rarely.
    """

    of: Likelihood
    model: FittedModel
    without: dict[str, FittedModel]
    held_out: Evaluation
    held_out_without: dict[str, Evaluation]
    floor_ratio: float
    quiet: Evaluation
    disturbed: Evaluation
    before: Evaluation
    before_ratio: float
    references: tuple[Departure, ...] = ()
    chance: float = 1.0


def held_out(seen: Evidence) -> list[Check]:
    """Each effect makes the part that it was not fitted to more probable."""
    checks = []
    for name, without in seen.held_out_without.items():
        gain = 2.0 * (seen.held_out.log_likelihood - without.log_likelihood)
        # A coefficient that is right loses nothing; one that is noise loses a chi-square of its own.
        checks.append(
            Check(
                "held out", gain > 0.0,
                f"on the part held out, {name} {gains(gain)}", name,
            )
        )  # fmt: skip
    return checks


def sign(seen: Evidence) -> list[Check]:
    """A coefficient that physics makes positive is not below zero by more than chance."""
    checks = []
    layout, deviation = seen.model.layout, seen.model.deviations
    for name in seen.without:
        effect = seen.of.effect(name)
        places = layout.of(name)[: len(effect.coefficients)]
        for coefficient, k in zip(effect.coefficients, places, strict=True):
            if not coefficient.positive:
                continue
            below = -seen.model.model.theta[k] / deviation[k]
            checks.append(
                Check(
                    "sign", bool(below < FORBIDDEN),
                    f"{coefficient.name} is {below:.3g} deviations below zero, which no such effect is" if below > 0.0
                    else f"{coefficient.name} is positive, as it must be", name,
                )
            )  # fmt: skip
    return checks


def prior(seen: Evidence) -> list[Check]:
    """The constants of the base model are where the bench file has them."""
    layout = seen.model.layout
    off = (seen.model.model.theta - layout.mean) / layout.deviation
    deviation = seen.model.deviations / layout.deviation
    checks = []
    for k in layout.constants:
        if layout.names[k] in layout.varying:
            continue
        sure = float(abs(off[k]) / np.hypot(1.0, deviation[k]))
        mean, half = layout.mean[k] * layout.factor[k], TWO_SIDED * seen.model.deviations[k] * abs(layout.factor[k])
        value = plus_minus(float(seen.model.model.theta[k] * layout.factor[k]), float(half))
        off_by = f"{abs(off[k]):.3g} of its declared deviations from the declared {significant(mean)}"
        cure = "" if sure < PRIOR else f": the record says {value} in SI units; correct the bench file"
        checks.append(Check("prior", sure < PRIOR, f"{layout.names[k]} is {off_by}{cure}"))
    return checks


def constancy(seen: Evidence) -> list[Check]:
    """An effect's coefficients are the same in all parts of the record: their scores scatter by no more than noise; of
    a run that nothing corrects, whose error remembers, by no more than those of all parameters do.
    """
    usual = 1.0 if seen.of.following is seen.of else seen.model.scatter
    evaluation, layout = seen.model.evaluation, seen.model.layout
    checks = []
    information, score = seen.model.posterior_information, evaluation.score / evaluation.scale
    for name in seen.without:
        rows = layout.of(name)
        others = [k for k in range(len(layout.names)) if k not in rows]
        own, taken = beside(information, rows, others)
        left = score[:, rows] - score[:, others] @ taken
        inverse = np.linalg.pinv(own)
        # Of each part, the score's power over its information; a ring-down has most of that in its first parts.
        ratio = float(np.einsum("bi,ij,bj->", left, inverse, left)) / len(rows) / usual
        parts = np.einsum("bij,ji->b", evaluation.information[:, rows][:, :, rows], inverse)
        freedom = len(rows) * max(float(parts.sum() ** 2 / np.sum(parts**2)) - 1.0, 1.0)
        limit = chi2_isf(RARE, freedom) / freedom
        checks.append(
            Check("constancy", ratio < 2.0 * limit, f"the scores of {name} scatter by {ratio:.3g} × noise", name)
        )
    return checks


def floor(seen: Evidence) -> list[Check]:
    """What the model leaves on the part held out is the noise floor."""
    return [
        Check(
            "noise floor", seen.floor_ratio < AT_FLOOR * seen.chance,
            f"the innovation of the part held out is {seen.floor_ratio:.4g} × the noise floor",
        )
    ]  # fmt: skip


def disturbance(seen: Evidence) -> list[Check]:
    """No nonparametric disturbance, a random force, explains a part of the innovation."""
    return [disturbed_by(seen.quiet, seen.disturbed)]


def disturbed_by(quiet: Evaluation, disturbed: Evaluation) -> Check:
    """The same of two passes: with the random force that is declared, and with the one that the record asks for."""
    more = 2.0 * (disturbed.logs.sum() - quiet.logs.sum()) / quiet.count.sum()
    share = 1.0 - float(disturbed.scale / quiet.scale * np.exp(more))
    told = (
        f"a nonparametric disturbance explains {share:.2%} of the innovation's power"
        if np.isfinite(share)
        else "without a random force the model loses the motion"
    )
    return Check("disturbance", share < DISTURBANCE, told)


def outliers(seen: Evidence) -> list[Check]:
    """What a filter leaves of the part held out is as large by its rms as by its median, as of normal numbers: an error
    of a few samples, of any form, is part of no noise.
    """
    if seen.of.axes == 1:  # a free run's error is no noise
        return []
    with np.errstate(invalid="ignore"):
        squares = (seen.held_out.innovation / seen.held_out.deviation) ** 2
    squares *= MEDIAN_OF_SQUARE / np.nanmedian(squares, axis=0)
    ratio, samples = float(np.max(np.sqrt(np.nanmean(squares, axis=0)))), int(np.sum(np.isfinite(squares[:, 0])))
    by_chance = np.exp(FORBIDDEN * np.sqrt(RMS_OVER_MEDIAN / samples))
    far = np.flatnonzero(np.any(squares > chi2_isf(RARE / samples, 1.0), axis=1))
    told = f"the part held out has longer tails than normal noise: its rms is {ratio:.4g} × what its median gives"
    if len(far):
        where = f"the first {far[0]} samples behind the start of that part"
        told = f"of {samples} samples held out, {len(far)} are far outside the noise, {where}"
    return [Check("outliers", bool(ratio < AT_FLOOR * by_chance), told)]


def reference(seen: Evidence) -> list[Check]:
    """Effects leave rate and angle no farther from a reference in the record than they were, or than is expected."""
    return [
        Check(
            "reference", one.after <= one.allowed,
            f"on the part held out the error of the {one.what} against the reference was {one.before:.3g} {one.unit} "
            f"and is {one.after:.3g}",
        )
        for one in seen.references
    ]  # fmt: skip


def agreement(model: FittedModel, evaluation: Evaluation, *, held_out: bool) -> list[Check]:
    """Each record of several has the constants and coefficients that they share: what it would gain by its own is no
    more than chance.

    At the pool's top the scores of a record that was fitted scatter by J − J C J, J being its information and C the
    covariance of what is shared; of one that was not, by J + J C J.
    """
    layout, records = model.layout, evaluation.records
    shared = layout.shared
    own = [k for k in range(len(layout.names)) if k not in shared]
    whole = np.linalg.inv(model.posterior_information)[np.ix_(shared, shared)]
    blocks = (len(records), -1)
    information = (evaluation.information / evaluation.scale).reshape(*blocks, *evaluation.information.shape[1:])
    scores = (evaluation.score / evaluation.scale).reshape(*blocks, len(layout.names))
    checks = []
    for name, parts, score in zip(records, information, scores, strict=True):
        total = parts.sum(axis=0)
        told, taken = beside(total, shared, own, model.prior_deviation[own])
        left = score[:, shared] - score[:, own] @ taken
        off = left.sum(axis=0)
        scatter = told @ whole @ told
        spread = told + scatter if held_out else told - scatter
        ratio, freedom = _over_chance(off, spread, told)
        usual = 1.0 if evaluation.share == 1.0 else max(_over_chance(left - left.mean(axis=0), told, told)[0], 1.0)
        limit = chi2_isf(RARE / len(records), freedom) / freedom
        worst = int(np.argmax(np.abs(off) / np.sqrt(np.maximum(np.diagonal(told), np.finfo(float).tiny))))
        k, moved = shared[worst], float(off[worst] / told[worst, worst])
        agrees = ratio < 2.0 * limit * usual
        sentence = (
            f"{name} agrees with what the records share: its scores scatter by {ratio:.3g} × noise"
            if agrees
            else (
                f"{name} does not agree with what the records share: its scores are {ratio / usual:.3g} × noise, "
                f"first of {layout.names[k]}, by {moved * layout.factor[k]:.3g} in SI units"
            )
        )
        checks.append(Check("agreement", bool(agrees), sentence))
    return checks


def _over_chance(score: Array, spread: Array, information: Array) -> tuple[float, int]:
    """The power of scores (k,) or, of several, (n, k) together, over their covariance (k, k), by degree of freedom; and
    how many these are: directions of which the information is enough.
    """
    size = np.sqrt(np.maximum(np.diagonal(information), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(spread / np.outer(size, size))
    told = values > SMALL
    along = (score / size) @ vectors[:, told] / np.sqrt(values[told])
    return float(np.sum(along**2)) / max(int(told.sum()), 1), max(int(told.sum()), 1)


CHECKS: tuple[Callable[[Evidence], list[Check]], ...] = (
    held_out,
    sign,
    prior,
    constancy,
    floor,
    disturbance,
    outliers,
    reference,
)
