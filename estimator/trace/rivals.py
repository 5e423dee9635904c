"""Who comes as near as the effect that was taken once both are carried: a record does not tell them apart."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.scaling import Array
from estimator.trace.candidates import Parameters, kind
from estimator.trace.criterion import TIE
from estimator.trace.dispersion import dispersed
from estimator.trace.engine import Step
from estimator.trace.fitting import Fitted, parameters_of
from estimator.trace.observer_model import Carrying
from estimator.trace.scan import PARTS


@dataclass(frozen=True)
class Rival:
    """Another account of what an effect was taken for.

    deficit: by how much less its likelihood is, price included, in twice the log-likelihood, over the whole record or
    behind its first part, if it is less there: what the observer's start alone tells hangs on how it was linearised;
    bound: a deficit that would be worth odds of 20 to 1; parameters: with which it was carried.
    """

    deficit: float
    bound: float
    parameters: Parameters


def rivals(step: Step[Carrying]) -> Mapping[str, Rival]:
    """The candidates of other kinds that the record does not tell from the one taken, the nearest first."""
    taken = step.trial
    found: dict[str, Rival] = {}
    for name, trial in step.beside.items():
        if kind(name) == kind(step.name):
            continue
        price = trial.score.price - taken.score.price
        lead = leads(taken.fit.fitted, trial.fit.fitted)
        deficit = price + float(min(np.sum(lead), np.sum(lead[1:])))
        bound = TIE * max(dispersion(taken.fit.fitted, trial.fit.fitted), 1.0)
        if deficit < bound:
            found[name] = Rival(deficit, bound, parameters_of(trial.fit.fitted, name))
    return dict(sorted(found.items(), key=lambda item: item[1].deficit))


def leads(model: Fitted, other: Fitted) -> Array:
    """By how much twice the log-likelihood of a model is larger than another's, by part of the record (parts,)."""
    (one, spread), (two, spread_of_other) = (
        (fitted.estimates.innovation, fitted.estimates.innovation_deviation) for fitted in (model, other)
    )
    with np.errstate(invalid="ignore"):
        lead = (two / spread_of_other) ** 2 - (one / spread) ** 2 + 2.0 * np.log(spread_of_other / spread)
    return np.array([np.nansum(part) for part in np.array_split(lead, PARTS)])


def dispersion(model: Fitted, other: Fitted) -> float:
    """By how much a difference of the two likelihoods is less sure than white innovations would make it."""
    with np.errstate(invalid="ignore"):
        one, two = (fitted.estimates.innovation / fitted.estimates.innovation_deviation for fitted in (model, other))
    return dispersed(one, two)
