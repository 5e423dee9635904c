"""Effects that a record cannot tell apart: in place of one another they make it as probable."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from estimator.effects.labels import kind
from estimator.side_by_side import side_by_side
from estimator.trace.exchange import Exchange, exchange_test
from estimator.trace.fit import RISE, FittedModel, advanced, at, settle
from estimator.trace.likelihood import TIE, Likelihood
from estimator.trace.score_test import score_test
from estimator.trace.search import (
    QUICK,
    carried_over,
    forbidden,
    impossible,
    joined,
    reduced,
    without_effect,
)

SHARE = 0.1
"""Of what an effect gains: a candidate that loses less in its place, on a parabola that holds near by, is fitted."""


@dataclass(frozen=True)
class Member:
    """An effect in place of one of a model's: its likeness to it, the model with it, and by how much that one's
    criterion is less.
    """

    name: str
    likeness: float
    model: FittedModel
    deficit: float


def exchanged(of: Likelihood, best: FittedModel) -> tuple[FittedModel, dict[str, list[Member]]]:
    """The model with each of its effects replaced by the one with the largest criterion in its place, and the groups:
    members that the record cannot tell from each.
    """
    while True:
        groups = members(of, best)
        found = min(
            (member for group in groups.values() for member in group), key=lambda one: one.deficit, default=None
        )
        better = best if found is None or found.deficit > -RISE else settle(of, found.model)
        if better.criterion < best.criterion + RISE:  # as well where that was only half fitted, or it would never end
            return best, {name: [one for one in group if one.deficit < TIE] for name, group in groups.items()}
        best = better


def members(of: Likelihood, best: FittedModel) -> dict[str, list[Member]]:
    """For each effect those that may explain the record as well in its place, each fitted; the best first."""
    names = [name for name in best.model.effects if name not in of.effects]
    if not names:
        return {}
    known = replace(best.model, effects=best.layout.effects_of(best.model))
    by_parabola = [name for name in names if best.begins_at_zero(name)]
    tests = exchange_test(of, best, of.candidates(known, best.evaluation), by_parabola) if by_parabola else {}
    kinds = {name: {kind(one) for one in best.model.effects if one != name} | {kind(name)} for name in names}
    found = {
        name: (tests[name], best.without(name)[0]) if name in tests else _beside_the_rest(of, best, name)
        for name in names
    }
    pairs = [
        (name, exchange)
        for name, (exchanges, loss) in found.items()
        for exchange in _first_of_each_kind(of, exchanges, kinds[name], max(SHARE * loss, TIE))
    ]
    quick = of.part(slice(0, QUICK))
    if quick.samples < of.samples:
        usual = advanced(quick, at(quick, best.layout, best.model)).criterion
        tried = side_by_side([partial(_exchanged, quick, best, name, exchange) for name, exchange in pairs])
        pairs = [pair for pair, one in zip(pairs, tried, strict=True) if one.criterion > usual - TIE]
    fitted = side_by_side([partial(_exchanged, of, best, name, exchange) for name, exchange in pairs])
    groups: dict[str, list[Member]] = {name: [] for name in names}
    for (name, exchange), one in zip(pairs, fitted, strict=True):
        if one.evaluation.sound and not impossible(of, exchange.name, one):
            groups[name].append(Member(exchange.name, exchange.likeness, one, best.criterion - one.criterion))
    return {name: sorted(group, key=lambda member: member.deficit) for name, group in groups.items()}


def _beside_the_rest(of: Likelihood, best: FittedModel, name: str) -> tuple[list[Exchange], float]:
    """Each candidate in place of an effect that does not begin at zero, by the scores of the model without it; and what
    the effect gains there.
    """
    rest = settle(of, without_effect(of, best, name))
    known = replace(rest.model, effects=rest.layout.effects_of(rest.model))
    given = best.layout.effects_of(best.model)[name]
    scores = score_test(of, rest, {**of.candidates(known, rest.evaluation), name: given})
    own = next(one.gain for one in scores if one.name == name)
    theta = carried_over(rest, best.layout)
    return [
        Exchange(
            one.name,
            one.given,
            own - one.gain,
            float(np.sqrt(np.clip(one.gain / own, 0.0, 1.0))),
            one.size,
            one.deviation,
            theta,
        )
        for one in scores
        if one.name != name
    ], own


def _first_of_each_kind(of: Likelihood, exchanges: list[Exchange], taken: set[str], most: float) -> list[Exchange]:
    found: dict[str, Exchange] = {}
    for one in exchanges:
        possible = not forbidden(of, one.name, one.size, one.deviation)
        if one.loss < most and kind(one.name) not in taken and possible:
            found.setdefault(kind(one.name), one)
    return list(found.values())


def _exchanged(of: Likelihood, best: FittedModel, name: str, exchange: Exchange) -> FittedModel:
    """The model with a candidate in place of an effect, fitted from where the parabola has its top."""
    layout, model = reduced(of, best, name, exchange.theta)
    less = replace(best, layout=layout, model=model)
    joint = joined(of, less, exchange.name, exchange.given, exchange.size)
    return advanced(of, advanced(of, at(of, *joint)))
