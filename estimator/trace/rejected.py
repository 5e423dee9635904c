"""Effects that a trace does not name: why not, and how large they can be at most."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.chance import TWO_SIDED
from estimator.diagnosis import Interval, Rejected
from estimator.effects.declaration import Effect
from estimator.effects.labels import kind
from estimator.scaling import Scaling
from estimator.settings import Device
from estimator.trace.ambiguity import Member
from estimator.trace.fit import FittedModel
from estimator.trace.likelihood import Likelihood
from estimator.trace.named import intervals_of
from estimator.trace.score_test import Score
from estimator.trace.search import Search, forbidden, margin

ROUNDING = 1e-6
"""Of the information in a plausible size: a record that tells less tells nothing."""


class Failed(NamedTuple):
    """An effect that a check took out of a model again: its sentence, and the model that had it."""

    sentence: str
    model: FittedModel


def rejected(
    of: Likelihood, device: Device, found: Search, groups: Mapping[str, list[Member]], failed: Mapping[str, Failed]
) -> tuple[Rejected, ...]:
    """Every kind that is not named, once: what it gains beside the model, and a 95 % bound on its coefficients.

    groups: of each named effect, the other members; failed: effects that a check took out again.
    """
    last = found.rounds[-1]
    alone = {score.name: score.gain for score in found.rounds[0].table}
    fitted = {name: one.rise_over(last.base) for name, one in last.fitted}
    members = {kind(member.name): kind(name) for name, group in groups.items() for member in group}
    named = {kind(name) for name in groups} - {kind(name) for name in failed}
    least = margin(len({kind(score.name) for score in last.table}))
    answers = {kind(name): _taken_out(of, name, one) for name, one in failed.items()}
    for score in last.table:
        which = kind(score.name)
        if which in named or which in answers:
            continue
        gain = fitted.get(score.name, score.gain)
        if which in members:
            reason = f"this record does not separate it from {members[which]}"
        elif forbidden(of, score.name, score.size, score.deviation):
            reason = "a coefficient that is never negative would be"
        elif gain < least:
            reason = f"gains {gain:.4g} in twice the log-likelihood: no more than chance"
        else:
            reason = f"gains {gain:.4g} in twice the log-likelihood, less than its parameters cost"
        bound = _bound(of, score, Scaling.of(device))
        answers[which] = Rejected(which, reason, bound, alone.get(score.name), fitted.get(score.name))
    return tuple(answers.values())


def _taken_out(of: Likelihood, name: str, failed: Failed) -> Rejected:
    """It may be nothing, or as large as it was fitted."""
    effect = of.effect(name)
    if not isinstance(effect, Effect):
        return Rejected(kind(name), failed.sentence)
    found = intervals_of(effect, failed.model, name)
    bound = {symbol: replace(one, low=min(one.low, 0.0), high=max(one.high, 0.0)) for symbol, one in found.items()}
    return Rejected(kind(name), failed.sentence, bound)


def _bound(of: Likelihood, score: Score, scaling: Scaling) -> dict[str, Interval]:
    """Of each coefficient, less what the plausible size of the effect says of it; unbounded where that is all."""
    bound: dict[str, Interval] = {}
    wider = TWO_SIDED * float(np.sqrt(max(score.scatter, 1.0)))
    effect = of.effect(score.name)
    if not isinstance(effect, Effect):
        return bound
    plausible = of.plausible(score.name)
    for c, size, deviation, likely in zip(effect.coefficients, score.size, score.deviation, plausible, strict=True):
        told, unit = float(deviation**-2.0 - likely**-2.0), scaling.coefficient(c)
        if told > ROUNDING * float(likely) ** -2.0:
            value, half = unit * float(size / (deviation**2 * told)), wider * abs(unit) / told**0.5
        else:
            value, half = unit * float(size), np.inf
        bound[kind(c.name)] = Interval(value, value - half, value + half, c.unit)
    return bound
