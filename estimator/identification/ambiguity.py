"""Effects that a record cannot tell apart: in place of one another they make it as probable."""

from dataclasses import dataclass
from functools import partial

from estimator.identification.fit import FittedModel, settle
from estimator.identification.likelihood import Likelihood
from estimator.identification.score_test import Score
from estimator.identification.search import scored, with_effect, without_effect
from estimator.side_by_side import side_by_side
from estimator.trace.candidates import kind

TIE = 9.0
"""Of twice the log-likelihood: odds of a hundred to one, below which two accounts are told together."""
BEYOND = 20.0
"""Times that, by which an effect may be behind by its likeness alone and is still fitted: it is of one place."""
SWAPS = 3
"""Effects that are replaced in a search: a fourth would be a circle."""
RIVALS = 4
"""Members of a group that are looked for."""


@dataclass(frozen=True)
class Member:
    """An effect in place of one of a model's: its likeness to it, the model with it, and by how much that one's
    standing is less.
    """

    name: str
    likeness: float
    model: FittedModel
    deficit: float


def exchanged(of: Likelihood, best: FittedModel) -> tuple[FittedModel, dict[str, list[Member]]]:
    """The model with each of its effects replaced by the one that stands best in its place, and the groups: members
    that the record cannot tell from each.
    """
    groups: dict[str, list[Member]] = {}
    swaps = 0
    while names := [name for name in best.model.effects if name not in of.effects and name not in groups]:
        found = members(of, best, names[0])
        if found and found[0].deficit < 0.0 and swaps < SWAPS:
            best, swaps, groups = found[0].model, swaps + 1, {}
        else:
            groups[names[0]] = [member for member in found if member.deficit < TIE]
    return best, groups


def members(of: Likelihood, best: FittedModel, name: str) -> list[Member]:
    """Effects that may explain the record as well in place of `name`, each fitted; the best first."""
    without = without_effect(of, best, name)
    kinds = {kind(one) for one in best.model.effects} - {kind(name)}
    tested = {
        other: given
        for other, given in of.candidates(without.model, without.evaluation).items()
        if kind(other) not in kinds and kind(other) != kind(name)
    }
    reference = {name: best.layout.effects_of(best.model)[name]}
    gain = best.criterion - without.criterion
    alike: dict[str, Score] = {}
    for score in scored(of, without, tested, reference)[-1]:
        # On a parabola, what explains a share of a signature loses the rest of what that gains.
        near_enough = gain * (1.0 - score.likeness**2) < BEYOND * TIE
        known = alike.get(kind(score.name))
        if near_enough and (known is None or score.likeness > known.likeness):
            alike[kind(score.name)] = score
    near = sorted(alike.values(), key=lambda score: -score.likeness)[:RIVALS]
    fitted = side_by_side([partial(_settled, of, without, score) for score in near])
    found = [
        Member(score.name, score.likeness, one, best.criterion - one.criterion)
        for score, one in zip(near, fitted, strict=True)
    ]
    return sorted(found, key=lambda member: member.deficit)


def _settled(of: Likelihood, without: FittedModel, score: Score) -> FittedModel:
    return settle(of, with_effect(of, without, score))
