"""Every effect of the catalogue in place of one that the model has, from the passes of one score test.

At its top the likelihood is a parabola in the model's own parameters and in the coefficients of what is not in it.
Without an effect, and with a candidate at its most probable size, that parabola is lower by the loss: nothing where the
candidate does to the innovations what the effect does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.scaling import Array
from estimator.trace.fit import FittedModel, beside
from estimator.trace.likelihood import Likelihood
from estimator.trace.problem import Effects
from estimator.trace.score_test import Tested, tested_beside


@dataclass(frozen=True)
class Exchange:
    """A candidate in place of an effect.

    loss: of twice the log-likelihood; likeness: largest canonical correlation of what the two do to the innovations, 1:
    the same to this record; size, deviation (c,) of its coefficients, scaled; theta (k,) the model's own parameters
    then.
    """

    name: str
    given: Mapping[str, float]
    loss: float
    likeness: float
    size: Array
    deviation: Array
    theta: Array


def exchange_test(
    of: Likelihood, fitted: FittedModel, candidates: Effects, names: Sequence[str]
) -> dict[str, list[Exchange]]:
    """Each candidate in place of each effect in `names`, the smallest loss first."""
    passes = tested_beside(of, fitted, candidates)

    def all_of(name: str) -> list[Exchange]:
        found = [
            _exchange(fitted, seen, name, other, candidates[other], of.plausible(other))
            for seen in passes
            for other in seen.columns
        ]
        return sorted(found, key=lambda one: one.loss)

    return {name: all_of(name) for name in names}


def _exchange(
    fitted: FittedModel, seen: Tested, name: str, other: str, given: Mapping[str, float], sizes: Array
) -> Exchange:
    columns = seen.columns[other]
    own, rest = fitted.parted(name)
    information, score = seen.information.sum(axis=0), seen.score.sum(axis=0)
    both = [*own, *columns]
    left, taken = beside(information, both, rest, fitted.prior_deviation[rest])
    removed, n = fitted.removed(name), len(own)
    slope = score[columns] - left[n:, :n] @ removed
    covariance = np.linalg.inv(left[n:, n:] + np.diag(sizes**-2.0))
    size = covariance @ slope
    theta = fitted.model.theta.copy()
    theta[rest] -= taken @ [*removed, *size]
    loss = fitted.twice_log_likelihood_of(float(removed @ left[:n, :n] @ removed - slope @ size))
    return Exchange(other, given, loss, _likeness(left, n), size, np.sqrt(np.diagonal(covariance)), theta)


def _likeness(information: Array, first: int) -> float:
    one, two = _whitener(information[:first, :first]), _whitener(information[first:, first:])
    return min(float(np.linalg.norm(one @ information[:first, first:] @ two.T, 2)), 1.0)


def _whitener(information: Array) -> Array:
    values, vectors = np.linalg.eigh(information)
    kept = values > 1e-12 * max(values[-1], np.finfo(float).tiny)
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T)
