"""Every effect that is not in the model: what it would gain, and how large it would be, from one pass.

The score statistic (Rao, 1948) of an effect with all parameters of the model projected out is what the effect would
gain if the likelihood were a parabola; the solution of its normal equations is its size.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import count

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

    gain: twice the gain of log-likelihood; size (c,) of its coefficients, scaled; deviation (c,) of them; scatter: by
    how much more than noise its score differs from part to part of the record, 1 where it does not; given: its
    parameters, SI; signature (c, m): normalised, for a comparison with others (`likeness`).
    """

    name: str
    gain: float
    size: Array
    deviation: Array
    scatter: float
    given: Mapping[str, float]

    @property
    def robust(self) -> float:
        """The gain where what the model leaves is no white noise: over the scatter."""
        return self.gain / max(self.scatter, 1.0)


@dataclass(frozen=True)
class ScoreTable:
    """The scores of a catalogue, the largest gain first; columns of each in `cross`, the information between them with
    the model's parameters projected out.
    """

    scores: tuple[Score, ...]
    columns: Mapping[str, list[int]]
    cross: Array

    def of(self, name: str) -> Score | None:
        """That of one effect."""
        return next((score for score in self.scores if score.name == name), None)

    def likeness(self, name: str, other: str) -> float:
        """Largest canonical correlation of what two effects would do to the innovations, 1: the same to this record; of
        the one that the others were tested beside (`score_test`), and any other.
        """
        one, two = self.columns[name], self.columns[other]
        a, b = (_whitener(self.cross[np.ix_(rows, rows)]) for rows in (one, two))
        return float(np.linalg.norm(a @ self.cross[np.ix_(one, two)] @ b.T, 2))


def _whitener(information: Array) -> Array:
    values, vectors = np.linalg.eigh(information)
    kept = values > 1e-12 * max(values[-1], np.finfo(float).tiny)
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T)


def score_test(of: Likelihood, fitted: FittedModel, watched: Effects, beside: str = "") -> ScoreTable:
    """The scores of `watched` beside a fitted model, each with a prior of its plausible size.

    beside: the one of them that is to be compared with all others (`ScoreTable.likeness`): it is in each of the passes.
    """
    shares = _shares(of, watched, len(fitted.layout.effects), beside)
    passes = side_by_side([partial(of.evaluate, fitted.layout, fitted.model, watched=share) for share in shares])
    own = len(fitted.layout.names)
    joined = _joined(passes, own + (len(of.effect(beside).coefficients) if beside else 0))
    names = joined.names[own:]
    sizes = [c.plausible for name in dict.fromkeys(names) for c in of.effect(name).coefficients]
    scale = fitted.evaluation.scale
    prior = np.diag(fitted.layout.deviation**-2.0)
    blocks = _projected(joined.information / scale, joined.score / scale, prior, own)
    information = blocks[0].sum(axis=0)
    columns: dict[str, list[int]] = {}
    for k, name in zip(count(), names):
        columns.setdefault(name, []).append(k)
    scores = [
        _score(name, columns[name], *blocks, np.array(sizes), watched[name]) for name in watched if name in columns
    ]
    return ScoreTable(tuple(sorted(scores, key=lambda one: -one.gain)), columns, information)


def _shares(of: Likelihood, watched: Effects, included: int, beside: str) -> list[Effects]:
    """The effects in as many passes as they need, and two where two may run at a time; `beside` first in each."""
    first = {beside: watched[beside]} if beside else {}
    needed = len(of.effect(beside).signals) if beside else 0
    shares: list[dict[str, Mapping[str, float]]] = [dict(first), dict(first)]
    signals = [needed, needed]
    for name, given in watched.items():
        if name == beside:
            continue
        wanted = len(of.effect(name).signals)
        at = int(np.argmin([len(share) for share in shares]))
        if len(shares[at]) + included + 2 > MAX_EFFECTS or signals[at] + wanted > MAX_SIGNALS - 16:
            shares.append(dict(first))
            signals.append(needed)
            at = len(shares) - 1
        shares[at][name] = given
        signals[at] += wanted
    return [share for share in shares if len(share) > len(first)] or [first]


def _joined(passes: list[Evaluation], own: int) -> Evaluation:
    """Passes with the same first `own` columns and different effects behind them, as one whose cross terms between the
    effects of different passes are those through the parameters only.
    """
    if len(passes) == 1:
        return passes[0]
    first = passes[0]
    sizes = [len(one.names) - own for one in passes]
    k = own + sum(sizes)
    information = np.zeros((len(first.score), k, k))
    score = np.zeros((len(first.score), k))
    information[:, :own, :own], score[:, :own] = first.information[:, :own, :own], first.score[:, :own]
    begin = own
    for one, size in zip(passes, sizes, strict=True):
        part = slice(begin, begin + size)
        information[:, part, part] = one.information[:, own:, own:]
        information[:, :own, part], information[:, part, :own] = (
            one.information[:, :own, own:],
            one.information[:, own:, :own],
        )
        score[:, part] = one.score[:, own:]
        begin += size
    names = (*first.names[:own], *(name for one in passes for name in one.names[own:]))
    return Evaluation(
        names, score, information, first.power, first.logs, first.count, first.innovation, first.deviation
    )


def _projected(information: Array, score: Array, prior: Array, own: int) -> tuple[Array, Array]:
    """By part of the record, information and score of the effects with the model's own parameters projected out."""
    whole = information.sum(axis=0)
    taken = np.linalg.solve(whole[:own, :own] + prior, whole[:own, own:])
    left = np.vstack([-taken, np.eye(whole.shape[0] - own)])
    return np.einsum("ka,bkl,lc->bac", left, information, left, optimize=True), score @ left


def _score(
    name: str, rows: list[int], information: Array, score: Array, sizes: Array, given: Mapping[str, float]
) -> Score:
    whole, slope = information.sum(axis=0)[np.ix_(rows, rows)], score.sum(axis=0)[rows]
    with_prior = whole + np.diag(sizes[rows] ** -2.0)
    try:
        covariance = np.linalg.inv(with_prior)
    except np.linalg.LinAlgError:
        return Score(name, 0.0, np.zeros(len(rows)), sizes[rows], 1.0, given)
    size = covariance @ slope
    # What is left of each part's score once the effect is there: noise, or something that is not this effect.
    parts = score[:, rows] - np.einsum("bij,j->bi", information[:, rows][:, :, rows], size)
    scatter = float(np.trace(covariance @ (parts.T @ parts))) / len(rows)
    return Score(name, float(slope @ size), size, np.sqrt(np.diagonal(covariance)), scatter, given)
