"""Effects that a record cannot tell apart: in place of one another they make it as probable."""

from functools import partial

from estimator.identification.candidates import kind
from estimator.identification.fit import FittedModel, settle
from estimator.identification.likelihood import Likelihood
from estimator.identification.score_test import Score
from estimator.identification.search import Search, scored, with_effect, without_effect
from estimator.side_by_side import side_by_side

TIE = 9.0
"""Of twice the log-likelihood: odds of a hundred to one, below which two accounts are told together."""
BEYOND = 20.0
"""Times that, by which an effect may be behind by its likeness alone and is still fitted: it is of one place."""
RIVALS = 4
"""Members of a group that are looked for."""


def members(of: Likelihood, found: Search, name: str) -> list[tuple[str, float, float]]:
    """Effects that explain the record as well in place of `name`: each with its likeness and by how much less it gains
    in twice the log-likelihood, what its coefficients cost included.
    """
    best = found.best
    without = without_effect(of, best, name)
    watched = {
        other: given
        for other, given in of.candidates(without.model, without.evaluation).items()
        if kind(other) not in {kind(one) for one in best.model.effects}
    }
    watched[name] = dict(best.layout.effects_of(best.model)[name])
    table = scored(of, without, watched)[-1]
    gain = 2.0 * (best.objective - without.objective)
    alike: dict[str, tuple[Score, float]] = {}
    for score in table.scores:
        if score.name == name:
            continue
        likeness = min(table.likeness(name, score.name), 1.0)
        # On a parabola, what explains a share of a signature loses the rest of what that gains.
        if gain * (1.0 - likeness**2) < BEYOND * TIE and likeness > alike.get(kind(score.name), (None, 0.0))[1]:
            alike[kind(score.name)] = (score, likeness)
    near = sorted(alike.values(), key=lambda pair: -pair[1])[:RIVALS]
    fitted = side_by_side([partial(_settled, of, without, score) for score, _ in near])
    group = []
    for (score, likeness), one in zip(near, fitted, strict=True):
        deficit = best.standing - one.standing
        if deficit < TIE:
            group.append((score.name, likeness, float(deficit)))
    return sorted(group, key=lambda item: item[2])


def _settled(of: Likelihood, without: FittedModel, score: Score) -> FittedModel:
    return settle(of, with_effect(of, without, score))
