"""Which effects belong in the model: forward by the score test, fitted candidates, and backward again."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from estimator.effects.catalogue import EFFECTS, effect_for
from estimator.identification.candidates import candidates, kind
from estimator.identification.fit import FittedModel, advanced, at, climb, finished, fit, settle
from estimator.identification.likelihood import Layout, Model
from estimator.identification.noise import declared_noise, quieten
from estimator.identification.score_test import Score, ScoreTable, score_test
from estimator.scaling import Array
from estimator.side_by_side import side_by_side
from estimator.trace.problem import Effects, Problem

SHORTLIST = 6
"""Kinds of effects that are fitted in a round: the score test has the right one among the first few."""
FINALISTS = 3
"""Candidates of a round that are fitted to their top."""
MOST = 4
"""Effects that a model may have beside the declared: nobody believes a fifth."""
CHANCE = 1e-3
"""How often an effect may be named that is not there, over a whole search."""
QUIETER = 100.0
"""By how much less random force than a model leaves the scores are taken once more."""
WORTH = 10.0
"""Gain below which a candidate is not worth a fit: less than any penalty."""


@dataclass(frozen=True)
class Round:
    """One step of the search: the model that it began with, its scores, the fitted candidates, the best first."""

    base: FittedModel
    table: ScoreTable
    fitted: tuple[tuple[str, FittedModel], ...]
    taken: str | None


@dataclass(frozen=True)
class Search:
    """What was chosen, and how: the rounds, and the base model."""

    base: FittedModel
    best: FittedModel
    rounds: tuple[Round, ...]


def penalty(coefficients: int, kinds: int, samples: float) -> float:
    """What twice the gain of log-likelihood has to exceed: BIC for the coefficients, and the number of kinds that were
    looked at (Bonferroni at `CHANCE`).
    """
    return coefficients * float(np.log(samples)) + 2.0 * float(np.log(kinds / CHANCE))


def search(problem: Problem, progress: Callable[[str, int, int], None] = lambda stage, done, total: None) -> Search:
    """Effects added while the best of the candidates gains more than the penalty, and taken out where they do not."""
    base = now = fit(problem, problem.effects)
    rounds: list[Round] = []
    for step in range(MOST):
        progress("effects", step, MOST)
        watched = candidates(problem, now)
        tables = scored(problem, now, watched)
        kinds = len({kind(name) for name in watched})
        shortlist = shortlisted(tables)
        ranked = _fitted(problem, now, shortlist)
        gain = ranked[0][1].objective - now.objective if ranked else 0.0
        taken = None
        if ranked and 2.0 * gain > penalty(_size(problem, ranked[0][0]), kinds, float(now.evaluation.count.sum())):
            taken = ranked[0][0]
        rounds.append(Round(now, tables[0], tuple(ranked), taken))
        if taken is None:
            break
        now = finished(problem, ranked[0][1])
    return Search(base, backward(problem, now, len(EFFECTS)), tuple(rounds))


def _fitted(problem: Problem, base: FittedModel, shortlist: list[Score]) -> list[tuple[str, FittedModel]]:
    """The candidates, each joined to the model and fitted, the best first; those that fall behind are not fitted to
    their top.
    """
    begun = side_by_side([lambda score=score: with_effect(problem, base, score) for score in shortlist])
    ranked = sorted(zip([score.name for score in shortlist], begun, strict=True), key=lambda p: -_standing(problem, *p))
    ahead = ranked[:FINALISTS]
    done = side_by_side([lambda model=model: settle(problem, model) for _, model in ahead])
    settled = sorted(zip([name for name, _ in ahead], done, strict=True), key=lambda p: -_standing(problem, *p))
    return [*settled, *ranked[FINALISTS:]]


def _standing(problem: Problem, name: str, fitted: FittedModel) -> float:
    """Twice the log-likelihood, less what the coefficients cost."""
    samples = float(fitted.evaluation.count.sum())
    return 2.0 * fitted.objective - _size(problem, name) * float(np.log(samples))


def _size(problem: Problem, name: str) -> int:
    return len(effect_for(name, problem.device.axes, problem.device.own)[1].coefficients)


def scored(problem: Problem, fitted: FittedModel, watched: Effects) -> tuple[ScoreTable, ...]:
    """The scores of the effects beside a model; and where it leaves a random force larger than declared, the same at a
    quieter one, where effects look less alike, unless the filter loses the motion there.
    """
    table = score_test(problem, fitted, watched)
    noise, quietest = fitted.model.noise, declared_noise(problem).force
    if noise.force <= quietest * QUIETER:
        return (table,)
    quieter = replace(fitted.model, noise=replace(noise, force=max(noise.force / QUIETER, quietest)))
    found = climb(problem, at(problem, fitted.layout, quieter))
    return (table, score_test(problem, found, watched)) if found.evaluation.sound else (table,)


def shortlisted(tables: tuple[ScoreTable, ...]) -> list[Score]:
    """The best of each kind, the largest gain first, from each of the tables in turn, as many as are fitted."""
    best: dict[str, Score] = {}
    orders = [[score for score in table.scores if score.gain > WORTH] for table in reversed(tables)]
    for turn in zip_longest(*orders):
        for score in turn:
            if score is not None:
                best.setdefault(kind(score.name), score)
    return list(best.values())[:SHORTLIST]


def with_effect(problem: Problem, fitted: FittedModel, score: Score) -> FittedModel:
    """The model with one more effect, from the size that the score test tells."""
    effects = {**fitted.layout.effects_of(fitted.model), score.name: score.given}
    layout = Layout(problem, effects)
    theta = layout.mean.copy()
    _carry_over(fitted, layout, theta)
    for k, size in zip(layout.of(score.name), score.size, strict=False):
        theta[k] = max(size, layout.least[k])
    model = Model(effects, theta, fitted.model.noise)
    begun = climb(problem, at(problem, layout, model), 3)
    if not begun.evaluation.sound or begun.objective < fitted.objective:
        for k in layout.of(score.name)[: len(score.size)]:
            theta[k] = layout.mean[k]
        begun = climb(problem, at(problem, layout, replace(model, theta=theta)), 6)
    return advanced(problem, at(problem, layout, quieten(problem, layout, begun.model)))


def _carry_over(fitted: FittedModel, layout: Layout, theta: Array) -> None:
    """Into theta, the values of a fitted model's parameters."""
    known = {(o, n): v for o, n, v in zip(fitted.layout.owner, fitted.layout.names, fitted.model.theta, strict=True)}
    for k, key in enumerate(zip(layout.owner, layout.names, strict=True)):
        theta[k] = known.get(key, theta[k])


def without_effect(problem: Problem, fitted: FittedModel, name: str) -> FittedModel:
    """The model with one effect less, fitted anew."""
    effects = {other: given for other, given in fitted.layout.effects_of(fitted.model).items() if other != name}
    layout = Layout(problem, effects)
    theta = layout.mean.copy()
    _carry_over(fitted, layout, theta)
    return settle(problem, at(problem, layout, Model(effects, theta, fitted.model.noise)))


def backward(problem: Problem, fitted: FittedModel, kinds: int) -> FittedModel:
    """Without effects that do not pay for themselves beside the others."""
    while True:
        own = [name for name in fitted.model.effects if name not in problem.effects]
        if len(own) < 2:
            return fitted
        less = side_by_side([lambda name=name: without_effect(problem, fitted, name) for name in own])
        samples = float(fitted.evaluation.count.sum())
        costs = [
            2.0 * (fitted.objective - one.objective) - penalty(_size(problem, name), kinds, samples)
            for name, one in zip(own, less, strict=True)
        ]
        least = int(np.argmin(costs))
        if costs[least] > 0.0:
            return fitted
        fitted = less[least]
