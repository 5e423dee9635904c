"""How surely the coefficients of an effect are known."""

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.scaling import Array
from estimator.trace.fitting import Fitted, widening
from estimator.trace.searched import Searched


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
