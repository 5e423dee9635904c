"""On what a residual depends: regression with errors that allow for unequal variance and autocorrelation."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr
from scipy.special import stdtr

from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS

_SET = THRESHOLDS.residual

CONSTANT = "always"
"""Name of the regressor that is 1 throughout."""


@dataclass(frozen=True)
class Dependence:
    """Of a component on a regressor: `slope` per standard deviation of the regressor, t-value, log of its chance."""

    component: str
    regressor: str
    slope: float
    t: float
    log_p: float


def dependences(components: dict[str, Array], regressors: dict[str, Array]) -> tuple[Dependence, ...]:
    """Each component (b,) on all regressors (b,) and a constant at once.

    Regressors that do not vary, or that the others already say, are left out.  The variance of a slope is the larger of
    the ordinary one and that of Newey and West (1987).
    """
    names, design = _design(regressors, len(next(iter(components.values()))))
    found: list[Dependence] = []
    for component, target in components.items():
        slopes, variances = regress(target, design)
        free = len(target) - design.shape[1]
        for index, name in enumerate((CONSTANT, *names)):
            t = float(slopes[index] / math.sqrt(variances[index]))
            found.append(Dependence(component, name, float(slopes[index]), t, log_tail(t, free)))
    return tuple(found)


def regress(target: Array, design: Array) -> tuple[Array, Array]:
    """Least squares of target (b,) on design (b, k): slopes (k,) and their variances (k,)."""
    rows, columns = design.shape
    inverse = np.linalg.inv(design.T @ design)
    slopes = inverse @ (design.T @ target)
    error = target - design @ slopes
    ordinary = np.diag(inverse) * float(error @ error) / (rows - columns)
    score = design * error[:, None]
    middle = score.T @ score
    lags = int(4.0 * (rows / 100.0) ** (2.0 / 9.0))
    for lag in range(1, lags + 1):
        product = score[lag:].T @ score[:-lag]
        middle += (1.0 - lag / (lags + 1.0)) * (product + product.T)
    robust = np.diag(inverse @ middle @ inverse) * rows / (rows - columns)
    return slopes, np.asarray(np.maximum(ordinary, robust))


def log_tail(t: float, free: int) -> float:
    """log of the chance of a t-value this large on either side."""
    p = float(stdtr(free, -abs(t)))
    # |t| beyond what the tail can be computed for: its leading power
    log_p = math.log(p) if p > 0.0 else -free / 2.0 * math.log1p(t * t / free)
    return min(0.0, math.log(2.0) + log_p)


def _design(regressors: dict[str, Array], rows: int) -> tuple[list[str], Array]:
    """Constant and standardised regressors (rows, 1 + k) without those that add nothing, and the names of the k."""
    names, columns = [], []
    for name, values in regressors.items():
        spread = float(np.std(values))
        if spread > _SET.varies * float(np.max(np.abs(values), initial=0.0)) and np.isfinite(spread):
            names.append(name)
            columns.append((values - np.mean(values)) / spread)
    if not names:
        return [], np.ones((rows, 1))
    matrix = np.column_stack(columns)
    _, triangle, order = qr(matrix, mode="economic", pivoting=True)
    size = np.abs(np.diag(triangle))
    kept = sorted(order[size > _SET.dependent * size[0]])
    return [names[i] for i in kept], np.column_stack([np.ones(rows), matrix[:, kept]])
