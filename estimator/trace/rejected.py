"""Effects that a trace does not name: why not, and how large they can be at most."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.chance import TWO_SIDED
from estimator.diagnosis import Interval, Rejected, Separation
from estimator.effects.declaration import Effect
from estimator.effects.labels import kind
from estimator.scaling import Scaling
from estimator.trace.ambiguity import Member
from estimator.trace.checks import SMALL
from estimator.trace.fit import FittedModel
from estimator.trace.likelihood import Likelihood
from estimator.trace.named import intervals_of
from estimator.trace.score_test import Score
from estimator.trace.search import Search, forbidden, margin
from estimator.written import gains, significant


class Failed(NamedTuple):
    """An effect that a check took out of a model again: its sentence, and the model that had it."""

    sentence: str
    model: FittedModel


def rejected(
    of: Likelihood, found: Search, groups: Mapping[str, list[Member]], failed: Mapping[str, Failed],
    scaling: Scaling | None = None,
) -> tuple[Rejected, ...]:  # fmt: skip
    """Every kind that is not named, once: what it gains beside the model, and a 95 % bound on its coefficients.

    groups: of each named effect, the other members; failed: effects that a check took out again; scaling: None of
    readings that follow no motion, whose effects are not the catalogue's.
    """
    last = found.rounds[-1]
    latest = {score.name: score for one in found.rounds for score in one.table}
    beside = {score.name for score in last.table}
    alone = {score.name: score.gain for score in found.rounds[0].table}
    fitted = {name: one.rise_over(last.base) for name, one in last.fitted}
    members = {kind(member.name): kind(name) for name, group in groups.items() for member in group}
    named = {kind(name) for name in groups} - {kind(name) for name in failed}
    least = margin(len({kind(score.name) for score in last.table}))
    answers = {kind(name): _taken_out(of, name, one) for name, one in failed.items()}
    for score in latest.values():
        which = kind(score.name)
        if which in named or which in answers:
            continue
        gain = fitted.get(score.name, score.gain)
        if which in members:
            reason = f"this record does not separate it from {members[which]}"
        elif score.name not in beside:  # it was in the model, until others were
            reason = "with the others in the model it raises 2 ln L by less than its penalty"
        elif forbidden(of, score.name, score.size, score.deviation):
            reason = "a coefficient that is never negative would be"
        elif gain < least:
            reason = f"{gains(gain)} of the {significant(least)} that chance would need: no more than chance"
        else:
            reason = f"{gains(gain)}, less than its penalty"
        bound = _bound(of, score, scaling)
        answers[which] = Rejected(which, reason, bound, alone.get(score.name), fitted.get(score.name))
    return tuple(answers.values())


def ruled_out(others: Iterable[Rejected], separations: Iterable[Separation]) -> tuple[Rejected, ...]:
    """Those that are no member of an ambiguity group: a member is not ruled out."""
    members = {pair.other for pair in separations}
    return tuple(one for one in others if one.name not in members)


def _taken_out(of: Likelihood, name: str, failed: Failed) -> Rejected:
    """It may be nothing, or as large as it was fitted."""
    effect = of.effect(name)
    if not isinstance(effect, Effect):
        return Rejected(kind(name), failed.sentence)
    found = intervals_of(effect, failed.model, name)
    bound = {symbol: replace(one, low=min(one.low, 0.0), high=max(one.high, 0.0)) for symbol, one in found.items()}
    return Rejected(kind(name), failed.sentence, bound)


def _bound(of: Likelihood, score: Score, scaling: Scaling | None) -> dict[str, Interval]:
    """Of each coefficient, less what the plausible size of the effect says of it; unbounded where that is all."""
    bound: dict[str, Interval] = {}
    wider = TWO_SIDED * float(np.sqrt(max(score.scatter, 1.0)))
    effect = of.effect(score.name)
    if not isinstance(effect, Effect) or scaling is None:
        return bound
    plausible = of.plausible(score.name)
    for c, size, deviation, likely in zip(effect.coefficients, score.size, score.deviation, plausible, strict=True):
        told, unit = float(deviation**-2.0 - likely**-2.0), scaling.coefficient(c)
        if told > SMALL * float(likely) ** -2.0:
            value, half = unit * float(size / (deviation**2 * told)), wider * abs(unit) / told**0.5
        else:
            value, half = unit * float(size), np.inf
        bound[kind(c.name)] = Interval(value, value - half, value + half, c.unit)
    return bound
