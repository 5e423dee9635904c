"""How surely the coefficients of an effect are known."""

import numpy as np
from scipy.special import gammaincinv, ndtr

from estimator.effects.catalogue import effect_for
from estimator.scaling import Array
from estimator.trace.fitting import Fitted, widening
from estimator.trace.searched import Searched

TWO_SIDED = 1.959963984540054
"""Standard deviations to either side of a normal distribution's mean that hold 95 %."""


def all_of(coefficients: int) -> float:
    """Standard deviations to either side of each that hold so many coefficients together, as surely as one."""
    return float(np.sqrt(2.0 * gammaincinv(0.5 * coefficients, 1.0 - 2.0 * ndtr(-TWO_SIDED))))


def covariance_of(name: str, model: Fitted, searched: Searched) -> Array:
    """Covariance (k, k) of an effect's k coefficients, SI: of the estimates given the parameters, and what the
    parameters' own uncertainty moves them by.
    """
    observer = model.observer
    _, effect = effect_for(name, observer.device.axes, observer.device.own)
    rows = [observer.estimated.index(c.name) for c in effect.coefficients]
    covariance = observer.covariance[np.ix_(rows, rows)].copy()
    if searched.names:
        covariance += searched.moves @ searched.covariance @ searched.moves.T
    return np.asarray(widening(model) ** 2 * covariance)


def interval_of(parameter: str, value: float, model: Fitted, searched: Searched) -> tuple[float, float]:
    """95 % interval of a searched parameter, all of which are positive.  Where the likelihood had no top along it, the
    record says nothing of it: from nothing to infinity.
    """
    half = TWO_SIDED * widening(model) * searched.deviation(parameter)
    return (value - half, value + half) if half > 0.0 else (0.0, np.inf)
