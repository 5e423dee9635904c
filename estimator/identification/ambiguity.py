"""Effects that a record cannot tell apart: in place of one another they make it as probable."""

from functools import partial

import numpy as np

from estimator.identification.candidates import candidates, kind
from estimator.identification.fit import FittedModel, settle
from estimator.identification.score_test import Score
from estimator.identification.search import Search, scored, shortlisted, with_effect, without_effect
from estimator.side_by_side import side_by_side
from estimator.trace.problem import Problem

TIE = 9.0
"""Of twice the log-likelihood: odds of a hundred to one, below which two accounts are told together."""
ALIKE = 0.95
"""Canonical correlation above which two effects are tried in place of one another."""
RIVALS = 4
"""Members of a group that are looked for."""


def members(problem: Problem, found: Search, name: str) -> list[tuple[str, float, float]]:
    """Effects that explain the record as well in place of `name`: each with its likeness and by how much less it gains
    in twice the log-likelihood, what its coefficients cost included.
    """
    best = found.best
    without = without_effect(problem, best, name)
    watched = {
        other: given
        for other, given in candidates(problem, without).items()
        if kind(other) not in {kind(one) for one in best.model.effects}
    }
    watched[name] = {p: v for p, v in best.layout.effects_of(best.model)[name].items()}
    tables = scored(problem, without, watched)
    alike: dict[str, tuple[Score, float]] = {}
    for table in tables:
        for score in table.scores:
            if score.name == name:
                continue
            likeness = table.likeness(name, score.name)
            if likeness > ALIKE and likeness > alike.get(kind(score.name), (None, 0.0))[1]:
                alike[kind(score.name)] = (score, likeness)
    near = sorted(alike.values(), key=lambda pair: -pair[1])[:RIVALS]
    fitted = side_by_side([partial(_settled, problem, without, score) for score, _ in near])
    samples = np.log(float(best.evaluation.count.sum()))
    own = 2.0 * best.objective - len(best.layout.of(name)) * samples
    group = []
    for (score, likeness), one in zip(near, fitted, strict=True):
        deficit = own - (2.0 * one.objective - len(one.layout.of(score.name)) * samples)
        if deficit < TIE:
            group.append((score.name, likeness, float(deficit)))
    return sorted(group, key=lambda item: item[2])


def _settled(problem: Problem, without: FittedModel, score: Score) -> FittedModel:
    return settle(problem, with_effect(problem, without, score))
