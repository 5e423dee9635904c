"""How a pass over a record begins: about what an earlier one found, or with coefficients that stay as they are."""

import numpy as np

from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from estimator.trace.thresholds import THRESHOLDS

_SET = THRESHOLDS.start


def begin_about(observer: Observer, previous: Observer) -> None:
    """Give a new observer's constants the covariance `previous` ended with, widened; of the rate, which moves, without
    what it shared with them.

    The new observer carries what the previous one did, and may carry more behind.
    """
    states = observer.states
    block = slice(states, None)
    wide = observer.p[block, block]
    common = len(previous.p) - states
    wide[:common, :common] = previous.p[block, block] * _SET.wider**2
    if "rate" in observer.model.names:
        rate = observer.estimated.index("rate") - states
        own = observer.p[states + rate, states + rate]
        wide[rate, :] = 0.0
        wide[:, rate] = 0.0
        wide[rate, rate] = own
    observer.c[:] = observer.p


def first_coefficient(observer: Observer) -> int:
    """Row of the covariance from which on the coefficients of the effects stand."""
    return observer.states + len(observer.active) - sum(len(e.coefficients) for _, e in observer.effects)


def spread_of_coefficients(observer: Observer) -> Array:
    """Standard deviations (k,) of the effects' coefficients as they are now, scaled."""
    return np.asarray(np.sqrt(np.diagonal(observer.p)[first_coefficient(observer) :]))


def hold(observer: Observer) -> None:
    """Keep the coefficients of all effects where they are: known, so that nothing of them is learnt or forgotten."""
    first = first_coefficient(observer)
    for covariance in (observer.p, observer.c):
        covariance[first:, :] = 0.0
        covariance[:, first:] = 0.0
    constants = first - observer.states
    observer.spread[constants:] = 0.0
    observer.prior[constants:] = 0.0


def settled_from(settings: ObserverSettings, device: Device, samples: int) -> int:
    """First of so many samples that is scored: behind the start, but not beyond a share of a short record."""
    return min(settling(settings, device), samples // _SET.most)


def settling(settings: ObserverSettings, device: Device) -> int:
    """Samples after which a start from the declared guess is over."""
    return int(_SET.memories * min(settings.memory, _SET.longest_memory) * device.sample_rate)
