"""Every effect that is not in the model: what it would gain, and how large it would be, from one pass.

The score statistic (Rao, 1948) of an effect with all parameters of the model projected out is what the effect would
gain if the likelihood were a parabola; the solution of its normal equations is its size.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimator.core.layout import MAX_EFFECTS, MAX_SIGNALS
from estimator.scaling import Array
from estimator.side_by_side import side_by_side
from estimator.trace.fit import FittedModel, beside
from estimator.trace.likelihood import Evaluation, Likelihood
from estimator.trace.problem import Effects


@dataclass(frozen=True)
class Score:
    """One effect at given parameters.

    gain: twice the gain of log-likelihood; size, deviation (c,) of its coefficients, scaled, none of a sign that
    physics forbids; scatter: by how much more than noise its score differs from part to part of the record, 1 where it
    does not; given: its parameters, SI.
    """

    name: str
    gain: float
    size: Array
    deviation: Array
    scatter: float
    given: Mapping[str, float]

    @property
    def robust(self) -> float:
        """The gain as far as the record is sure of it, where what the model leaves is no white noise."""
        return self.gain / max(self.scatter, 1.0)


@dataclass(frozen=True)
class Tested:
    """A pass with effects beside a model: columns of each behind the model's own; information (blocks, k, k) and score
    (blocks, k) at the noise that is left.
    """

    columns: Mapping[str, list[int]]
    information: Array
    score: Array


def tested_beside(of: Likelihood, fitted: FittedModel, effects: Effects) -> list[Tested]:
    """The effects beside the model, in as many passes as they need."""
    shares = _shares(of, effects, len(fitted.model.effects))
    seen = side_by_side([partial(of.evaluate, fitted.layout, fitted.model, tested=share) for share in shares])
    return [tested_in(one, len(fitted.layout.names), fitted.evaluation.scale) for one in seen]


def tested_in(seen: Evaluation, own: int, scale: float) -> Tested:
    """What a pass has behind the model's `own` parameters."""
    columns: dict[str, list[int]] = {}
    for k, name in enumerate(seen.names[own:], start=own):
        columns.setdefault(name, []).append(k)
    return Tested(columns, seen.information / scale, seen.score / scale)


def score_test(of: Likelihood, fitted: FittedModel, effects: Effects) -> tuple[Score, ...]:
    """The scores of effects beside a fitted model, the largest gain first, each with a prior of its plausible size."""
    scores = [
        score
        for seen in tested_beside(of, fitted, effects)
        for score in scores_in(of, seen, fitted.prior_deviation, effects)
    ]
    return tuple(sorted(scores, key=lambda one: -one.gain))


def scores_in(of: Likelihood, seen: Tested, deviation: Array, effects: Effects) -> Iterator[Score]:
    """Those of one pass beside parameters of these prior deviations (k,)."""
    information, score = projected(seen.information, seen.score, deviation)
    for name, columns in seen.columns.items():
        rows = [k - len(deviation) for k in columns]
        positive = [one.positive and not one.is_shape for one in of.effect(name).coefficients]
        parts = information[:, rows][:, :, rows], score[:, rows]
        yield _score(name, *parts, of.plausible(name), np.array(positive[: len(rows)]), effects[name])


def _shares(of: Likelihood, tested: Effects, included: int) -> list[Effects]:
    """The effects in as many passes as they need, and two where two may run at a time."""

    needed = {name: len(of.effect(name).signals) for name in tested}

    def signals(names: Effects) -> int:
        return sum(needed[name] for name in names)

    shares: list[dict[str, Mapping[str, float]]] = [{}, {}]
    for name, given in tested.items():
        least = min(shares, key=len)
        full = len(least) + included >= MAX_EFFECTS
        if full or signals(least) + signals({name: given}) > MAX_SIGNALS // 2:
            shares.append(least := {})
        least[name] = given
    return [share for share in shares if share]


def projected(information: Array, score: Array, deviation: Array) -> tuple[Array, Array]:
    """By part of the record, information and score of the effects with the model's own parameters, of these prior
    deviations, projected out.
    """
    own, whole = len(deviation), information.sum(axis=0)
    _, taken = beside(whole, list(range(own, len(whole))), list(range(own)), deviation)
    left = np.vstack([-taken, np.eye(len(whole) - own)])
    return np.einsum("ka,bkl,lc->bac", left, information, left, optimize=True), score @ left


def _score(
    name: str, information: Array, score: Array, sizes: Array, positive: NDArray[np.bool_], given: Mapping[str, float]
) -> Score:
    """Of information (blocks, c, c) and score (blocks, c); coefficients (c,) that are never negative are zero where
    they would be.
    """
    whole, slope = information.sum(axis=0) + np.diag(sizes**-2.0), score.sum(axis=0)
    try:
        covariance = np.linalg.inv(whole)
    except np.linalg.LinAlgError:
        return Score(name, 0.0, np.zeros(len(sizes)), sizes, 1.0, given)
    size, free = covariance @ slope, np.ones(len(sizes), dtype=bool)
    while np.any(below := positive & (size < 0.0)):
        free &= ~below
        size = np.zeros(len(sizes))
        size[free] = np.linalg.solve(whole[np.ix_(free, free)], slope[free])
    # What is left of each part's score once the effect is there: noise, or something that is not this effect.
    parts = score - np.einsum("bij,j->bi", information, size)
    scatter = float(np.trace(covariance @ (parts.T @ parts))) / len(sizes)
    return Score(name, float(slope @ size), size, np.sqrt(np.diagonal(covariance)), scatter, given)
