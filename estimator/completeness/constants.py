"""The constants that a calibration declares, all of them a little off at once, as one account of a record.

A device as its bench file declares it has every gain, angle and delay off by some part of its standard uncertainty.  No
single effect explains such a record, and the one that comes nearest need not be there at all.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Device, Gain
from estimator.trace.fitting import coefficients_of, run, widening_of
from estimator.trace.problem import Problem
from estimator.trace.start import begin_moving


class Found(NamedTuple):
    """Constants as an observer takes them, by effect; the same (k,) with their covariance (k, k), SI."""

    given: dict[str, dict[str, float]]
    values: Array
    covariance: Array


@dataclass(frozen=True)
class Constants:
    """Effects of the catalogue all coefficients of which are declared, with the places of their coefficients among all
    k, and the declared standard deviation (k,) of each, SI.
    """

    places: Mapping[str, slice]
    deviation: Array

    @property
    def effects(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(self.places)

    def after(self, problem: Problem) -> "Found":
        """What the record leaves of the declared deviations, beside the other effects of the problem.  One pass from
        the declared values: where the record does not tell two constants apart, what is declared of each does.  Passes
        that begin about what was found, as a fit has them, leave that to chance.
        """
        device, others = (
            problem.device,
            {name: given for name, given in problem.effects.items() if name not in self.places},
        )
        carrying = problem.carrying({**others, **{name: {} for name in self.places}})
        observer = Observer(device, replace(carrying.settings, gain=Gain.EKF), problem.controller)
        names = [c.name for name in self.places for c in effect_for(name, device.axes, device.own)[1].coefficients]
        observer.assume(names, np.diag(self.deviation**2))
        begin_moving(observer, problem.record)
        estimates = run(observer, problem.record)
        rows = [observer.estimated.index(name) for name in names]
        values = dict(zip(observer.names, observer.state.tolist(), strict=True))
        wider = widening_of(estimates)
        return Found(
            {name: coefficients_of(observer)[name] for name in self.places},
            np.array([values[name] for name in names]),
            wider**2 * observer.covariance[np.ix_(rows, rows)],
        )


def constants_of(declared: Mapping[str, float], names: Collection[str], device: Device) -> Constants:
    """Those of the named effects of which every coefficient has a declared standard deviation, by symbol, SI."""
    places: dict[str, slice] = {}
    deviation: list[float] = []
    for name in names:
        symbols = [c.name.partition(":")[0] for c in effect_for(name, device.axes, device.own)[1].coefficients]
        if all(symbol in declared for symbol in symbols):
            places[name] = slice(len(deviation), len(deviation) + len(symbols))
            deviation += [declared[symbol] for symbol in symbols]
    return Constants(places, np.array(deviation))


def shares(terms: Array, places: Mapping[str, slice]) -> dict[str, float]:
    """The root of a sum of terms (k,), divided among effects so that the squares of their parts add up to that sum."""
    positive = np.maximum(terms, 0.0)
    whole = float(positive.sum())
    scale = max(float(terms.sum()), 0.0) / whole if whole > 0.0 else 0.0
    return {name: float(np.sqrt(scale * positive[of].sum())) for name, of in places.items()}
