"""Every effect that is not in the model: what it would gain, and how large it would be, from one pass.

The score statistic (Rao, 1948) of an effect with all parameters of the model projected out is what the effect would
gain if the likelihood were a parabola; the solution of its normal equations is its size.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np

from estimator.core.layout import MAX_EFFECTS, MAX_SIGNALS
from estimator.identification.fit import FittedModel
from estimator.identification.likelihood import Evaluation, Likelihood
from estimator.scaling import Array
from estimator.side_by_side import side_by_side
from estimator.trace.problem import Effects


@dataclass(frozen=True)
class Score:
    """One effect at given parameters.

    gain: twice the gain of log-likelihood; size, deviation (c,) of its coefficients, scaled; scatter: by how much more
    than noise its score differs from part to part of the record, 1 where it does not; given: its parameters, SI;
    likeness: largest canonical correlation of what it does to the innovations with what a reference does, 1: the same
    to this record.
    """

    name: str
    gain: float
    size: Array
    deviation: Array
    scatter: float
    given: Mapping[str, float]
    likeness: float = 0.0

    @property
    def robust(self) -> float:
        """The gain as far as the record is sure of it, where what the model leaves is no white noise."""
        return self.gain / max(self.scatter, 1.0)


def score_test(
    of: Likelihood, fitted: FittedModel, tested: Effects, reference: Effects = MappingProxyType({})
) -> tuple[Score, ...]:
    """The scores of `tested` beside a fitted model, the largest gain first, each with a prior of its plausible size;
    with their likeness to an effect at given parameters, where there is a `reference`.
    """
    shares = _shares(of, tested, reference, len(fitted.model.effects))
    passes = side_by_side(
        [partial(of.evaluate, fitted.layout, fitted.model, tested={**reference, **share}) for share in shares]
    )
    scores = [
        score
        for share, seen in zip(shares, passes, strict=True)
        for score in _scores(of, fitted, seen, share, next(iter(reference), None))
    ]
    return tuple(sorted(scores, key=lambda one: -one.gain))


def _scores(
    of: Likelihood, fitted: FittedModel, seen: Evaluation, tested: Effects, reference: str | None
) -> Iterator[Score]:
    """Those of one pass."""
    own, scale = len(fitted.layout.names), fitted.evaluation.scale
    information, score = projected(seen.information / scale, seen.score / scale, fitted.layout.deviation, own)
    whole = information.sum(axis=0)
    columns: dict[str, list[int]] = {}
    for k, name in enumerate(seen.names[own:]):
        columns.setdefault(name, []).append(k)
    for name, given in tested.items():
        rows = columns[name]
        one = _score(name, information[:, rows][:, :, rows], score[:, rows], of.plausible(name), given)
        likeness = _likeness(whole, columns[reference], rows) if reference is not None else 0.0
        yield replace(one, likeness=likeness)


def _likeness(information: Array, one: list[int], two: list[int]) -> float:
    a, b = (_whitener(information[np.ix_(rows, rows)]) for rows in (one, two))
    return min(float(np.linalg.norm(a @ information[np.ix_(one, two)] @ b.T, 2)), 1.0)


def _whitener(information: Array) -> Array:
    values, vectors = np.linalg.eigh(information)
    kept = values > 1e-12 * max(values[-1], np.finfo(float).tiny)
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T)


def _shares(of: Likelihood, tested: Effects, reference: Effects, included: int) -> list[Effects]:
    """The effects in as many passes as they need, and two where two may run at a time."""

    def signals(names: Effects) -> int:
        return sum(len(of.effect(name).signals) for name in names)

    shares: list[dict[str, Mapping[str, float]]] = [{}, {}]
    for name, given in tested.items():
        least = min(shares, key=len)
        full = len(least) + included + len(reference) >= MAX_EFFECTS
        if full or signals(least) + signals(reference) + signals({name: given}) > MAX_SIGNALS // 2:
            shares.append(least := {})
        least[name] = given
    return [share for share in shares if share]


def projected(information: Array, score: Array, deviation: Array, own: int) -> tuple[Array, Array]:
    """By part of the record, information and score of the effects with the model's own parameters projected out."""
    whole = information.sum(axis=0)
    taken = np.linalg.solve(whole[:own, :own] + np.diag(deviation**-2.0), whole[:own, own:])
    left = np.vstack([-taken, np.eye(whole.shape[0] - own)])
    return np.einsum("ka,bkl,lc->bac", left, information, left, optimize=True), score @ left


def _score(name: str, information: Array, score: Array, sizes: Array, given: Mapping[str, float]) -> Score:
    """Of information (blocks, c, c) and score (blocks, c)."""
    try:
        covariance = np.linalg.inv(information.sum(axis=0) + np.diag(sizes**-2.0))
    except np.linalg.LinAlgError:
        return Score(name, 0.0, np.zeros(len(sizes)), sizes, 1.0, given)
    slope = score.sum(axis=0)
    size = covariance @ slope
    # What is left of each part's score once the effect is there: noise, or something that is not this effect.
    parts = score - np.einsum("bij,j->bi", information, size)
    scatter = float(np.trace(covariance @ (parts.T @ parts))) / len(sizes)
    return Score(name, float(slope @ size), size, np.sqrt(np.diagonal(covariance)), scatter, given)
