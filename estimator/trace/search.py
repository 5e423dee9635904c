"""Which effects belong in the model: forward by the score test, fitted candidates, and backward again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from estimator.chance import chi2_isf
from estimator.effects.labels import kind
from estimator.scaling import Array
from estimator.side_by_side import side_by_side
from estimator.thresholds import THRESHOLDS
from estimator.trace.fit import ROUGH, FittedModel, advanced, at, finished, fit, maximise, settle
from estimator.trace.likelihood import RARE, TIE, Layout, Likelihood, Model
from estimator.trace.problem import Effects, Progress, unseen
from estimator.trace.score_test import Score, score_test

SHORTLIST = THRESHOLDS.candidates.strongest
"""Kinds of effects that are fitted in a round."""
QUICK = 8_000
"""Samples on which the shortlist is fitted first."""
FORBIDDEN = chi2_isf(2.0 * RARE, 1.0) ** 0.5
"""Deviations below zero of a coefficient that physics makes positive, beyond which it is no such effect."""


@dataclass(frozen=True)
class Round:
    """One step of the search: the model that it began with, its scores, the fitted candidates, the best first."""

    base: FittedModel
    table: tuple[Score, ...]
    fitted: tuple[tuple[str, FittedModel], ...]


@dataclass(frozen=True)
class Search:
    """What was chosen, and how: the rounds, and the base model."""

    base: FittedModel
    best: FittedModel
    rounds: tuple[Round, ...]

    @property
    def margin(self) -> float:
        """Of as many kinds as were tested."""
        return margin(max(1, *(len({kind(score.name) for score in one.table}) for one in self.rounds)))


def margin(kinds: int) -> float:
    """What an effect's criterion has to exceed that of a model without it, so many kinds having been looked at."""
    return 2.0 * float(np.log(kinds / RARE))


def search(of: Likelihood, progress: Progress = unseen) -> Search:
    """Effects added (`forward`), and taken out where their gain is not sure: on the way, what the model still lacks
    scatters more than noise.
    """
    found = forward(of, progress)
    return replace(found, best=backward(of, found.best, found.margin))


def forward(of: Likelihood, progress: Progress = unseen, begun: FittedModel | None = None) -> Search:
    """Effects added while the best of the candidates has a larger criterion by the margin; on from `begun`."""
    base = now = fit(of, of.effects) if begun is None else begun
    rounds: list[Round] = []
    kinds = 1
    for step in range(len(now.model.effects) - len(of.effects), of.most):
        progress("effects", step, of.most)
        table = score_test(of, now, of.candidates(now.model, now.evaluation))
        kinds = max(kinds, len({kind(score.name) for score in table}))
        ranked = fitted_candidates(of, now, shortlisted(table, now.evaluation.share * margin(kinds)))
        best = first_possible(of, ranked)
        rounds.append(Round(now, table, tuple(ranked)))
        if best is None or not best[1].surplus_over(now) > margin(kinds):
            break
        now = best[1]
    return Search(base, now, tuple(rounds))


def first_possible(of: Likelihood, ranked: list[tuple[str, FittedModel]]) -> tuple[str, FittedModel] | None:
    """The best of fitted candidates that has no sign which physics forbids."""
    return next((pair for pair in ranked if not impossible(of, *pair)), None)


def fitted_candidates(of: Likelihood, base: FittedModel, shortlist: Sequence[Score]) -> list[tuple[str, FittedModel]]:
    """The candidates, each joined to the model and fitted, the best first and to its top.

    On a beginning of the record first: those that are far behind there are not fitted to the whole, unless the score
    test has them first and that beginning has nothing of them, as of an effect that shows in a long record only.
    """
    quick = of.part(slice(0, QUICK))
    start = at(quick, base.layout, base.model)
    tried = side_by_side([partial(with_effect, quick, start, score) for score in shortlist])
    possible = [pair for pair in zip(shortlist, tried, strict=True) if not impossible(of, pair[0].name, pair[1])]
    best = max((one.criterion for _, one in possible), default=0.0)
    begun = [
        (score.name, partial(_from, of, one) if one.criterion > best - TIE else partial(with_effect, of, base, score))
        for score, one in possible
        if one.criterion > best - TIE or (score is shortlist[0] and one.criterion < start.criterion)
    ]
    done = side_by_side([fit for _, fit in begun])
    ranked = sorted(zip([name for name, _ in begun], done, strict=True), key=lambda pair: -pair[1].criterion)
    return [(name, finished(of, settle(of, one)) if one is ranked[0][1] else one) for name, one in ranked]


def _from(of: Likelihood, quick: FittedModel) -> FittedModel:
    """A candidate that was fitted to a beginning of the record, on all of it."""
    return advanced(of, at(of, quick.layout, quick.model))


def shortlisted(table: Sequence[Score], least: float) -> list[Score]:
    """The best of each kind, the largest gain first, as many as are fitted; none that gains less than `least`."""
    best: dict[str, Score] = {}
    for score in table:
        if score.gain > least:
            best.setdefault(kind(score.name), score)
    return list(best.values())[:SHORTLIST]


def impossible(of: Likelihood, name: str, fitted: FittedModel) -> bool:
    """Whether a fitted effect has a sign that physics forbids."""
    places = fitted.layout.of(name)
    deviation = np.sqrt(np.diagonal(np.linalg.pinv(fitted.posterior_information)))[places]
    return forbidden(of, name, fitted.model.theta[places], deviation)


def forbidden(of: Likelihood, name: str, size: Array, deviation: Array) -> bool:
    coefficients = of.effect(name).coefficients
    return any(
        one.positive and not one.is_shape and value < -FORBIDDEN * spread
        for one, value, spread in zip(coefficients, size, deviation, strict=False)
    )


def with_effect(of: Likelihood, fitted: FittedModel, score: Score) -> FittedModel:
    """The model with one more effect, from the size that the score test tells."""
    layout, model = joined(of, fitted, score.name, score.given, score.size)
    starts = [at(of, layout, one) for one in (model, _where_tested(layout, model, score.name)) if one is not None]
    found = maximise(of, max(starts, key=lambda one: one.objective), ROUGH)
    if not found.evaluation.sound or found.objective < fitted.objective:
        found = maximise(of, at(of, layout, replace(model, theta=carried_over(fitted, layout))), ROUGH)
    return settle(of, at(of, layout, of.quieten(layout, found.model)))


def _where_tested(layout: Layout, model: Model, name: str) -> Model | None:
    """The model with an effect's corners where they were tested; None where it has none.  A corner is one number with
    its coefficient, of which the score test tells a size with the corner held.
    """
    tested = {k: given / layout.factor[k] for k, (owner, _, given) in layout.tied.items() if owner == name}
    if not tested:
        return None
    theta = model.theta.copy()
    theta[list(tested)] = list(tested.values())
    return replace(model, theta=theta)


def joined(
    of: Likelihood, fitted: FittedModel, name: str, given: Mapping[str, float], size: Array
) -> tuple[Layout, Model]:
    """The parameters and the model with one more effect of that size (c,)."""
    bent = {one.name.partition(":")[0] for one in of.effect(name).coefficients if one.bent}
    begun = {key: value for key, value in given.items() if key not in bent}
    layout, model = with_effects(of, fitted, {**fitted.layout.effects_of(fitted.model), name: begun})
    return layout, replace(model, theta=of.begun(layout, model.theta, name, size))


def with_effects(of: Likelihood, fitted: FittedModel, effects: Effects) -> tuple[Layout, Model]:
    """The parameters of the model with these effects, and the model as the fitted one has them."""
    layout = of.layout(effects)
    return layout, Model(effects, carried_over(fitted, layout), fitted.model.noise)


def carried_over(fitted: FittedModel, layout: Layout) -> Array:
    """The parameters (k,) of a layout as a fitted model has them, those that it lacks as they are declared."""
    known = {(o, n): v for o, n, v in zip(fitted.layout.owner, fitted.layout.names, fitted.model.theta, strict=True)}
    keys = zip(layout.owner, layout.names, layout.mean, strict=True)
    return np.array([known.get((owner, name), mean) for owner, name, mean in keys])


def without_effect(of: Likelihood, fitted: FittedModel, name: str) -> FittedModel:
    """The model with one effect less, the others where the parabola of its likelihood has its top."""
    return at(of, *reduced(of, fitted, name, fitted.without(name)[1]))


def reduced(of: Likelihood, fitted: FittedModel, name: str, theta: Array) -> tuple[Layout, Model]:
    """The parameters and the model with one effect less; theta (k,) of the model with it."""
    moved = replace(fitted, model=replace(fitted.model, theta=theta))
    effects = {other: given for other, given in fitted.layout.effects_of(moved.model).items() if other != name}
    return with_effects(of, moved, effects)


def backward(of: Likelihood, fitted: FittedModel, margin: float) -> FittedModel:
    """Without effects that do not pay for themselves beside the others; one without which the motion is lost stays."""
    while gains := {name: gain_of(of, fitted, name) for name in fitted.model.effects if name not in of.effects}:
        least = min(gains, key=lambda name: gains[name])
        if gains[least] > margin:
            break
        less = settle(of, without_effect(of, fitted, least))
        if not less.evaluation.sound:
            break
        fitted = less
    return fitted


def with_defaults(of: Likelihood, fitted: FittedModel) -> FittedModel:
    """Parameters that were searched for are where the declarations of their effects have them, if the record tells no
    better: each costs as any other does.
    """
    for name, parameter in fitted.layout.has_default:
        effects = {other: dict(given) for other, given in fitted.layout.effects_of(fitted.model).items()}
        del effects[name][parameter]
        simpler = settle(of, at(of, *with_effects(of, fitted, effects)))
        fitted = simpler if simpler.criterion > fitted.criterion else fitted
    return fitted


def gain_of(of: Likelihood, fitted: FittedModel, name: str) -> float:
    """What a model gains by an effect, less what its parameters cost."""
    if fitted.begins_at_zero(name):
        return fitted.gain_of(name)
    return fitted.gain_over(settle(of, without_effect(of, fitted, name)))
