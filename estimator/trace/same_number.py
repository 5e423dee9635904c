"""A parameter that is the same number as one of the effect's coefficients: a corner that is also a size.

Where the coefficient is well determined, the parameter follows from it.  On a calm record it need not be: what a
high-pass does to a steady vibration is a delay, and its corner shows in how its start wanes; then the parameter is
searched for, and the coefficient has to agree with it.
"""

from collections.abc import Mapping

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.effects.declaration import Effect
from estimator.settings import Device
from estimator.thresholds import THRESHOLDS
from estimator.trace.fitting import Fitted, coefficients_of, fit, widening
from estimator.trace.problem import Effects, Problem
from estimator.trace.searched import Searched

_SET = THRESHOLDS.parameters


def same_numbers(effect: Effect) -> dict[str, str]:
    """By parameter the coefficient, as an observer calls it, that it is the same number as."""
    own = {c.symbol: c.name for c in effect.coefficients}
    return {p.name: own[p.found_as] for p in effect.parameters if p.found_as in own}


def in_step(problem: Problem, model: Fitted, name: str) -> tuple[Fitted, bool]:
    """`model` with those parameters of its effect that are one number with a coefficient set to what was found of that,
    and fitted again, until that moves it no more; and whether that is the effect as it is: each coefficient is what its
    parameter could be, and the innovations are as large as predicted.  Where the likelihood falls, it stays.
    """
    _, effect = effect_for(name, problem.device.axes, problem.device.own)
    same = same_numbers(effect)
    if not same:
        return model, True
    for _ in range(_SET.rounds):
        effects = coefficients_of(model.observer)
        given = effects[name]
        found = {parameter: given[coefficient.partition(":")[0]] for parameter, coefficient in same.items()}
        near = {parameter: _SET.near * _deviation(model, coefficient) for parameter, coefficient in same.items()}
        moved = {p: value for p, value in found.items() if value > 0.0 and abs(value - given[p]) > near[p]}
        if not moved:
            is_small = widening(model) ** 2 < 1.0 + THRESHOLDS.width.power
            return model, is_small and all(value > 0.0 for value in found.values())
        again = problem.under(model.settings).carrying({**effects, name: {**given, **moved}})
        following = fit(again, passes=1, about=model.observer)
        if not following.likelihood > model.likelihood - _SET.rough_start:
            return model, False
        model = following
    return model, False


def agree(problem: Problem, model: Fitted, name: str, searched: Searched) -> bool:
    """Whether each coefficient is what its parameter was found to be, as far as both are known."""
    _, effect = effect_for(name, problem.device.axes, problem.device.own)
    given = coefficients_of(model.observer)[name]
    symbols = [c.name for c in effect.coefficients]
    for parameter, coefficient in same_numbers(effect).items():
        if parameter not in searched.names:
            return False
        row = symbols.index(coefficient)
        moved = float(searched.moves[row] @ searched.covariance @ searched.moves[row])
        own = searched.deviation(parameter) ** 2
        deviation = widening(model) * float(np.sqrt(_deviation(model, coefficient) ** 2 + moved + own))
        if own == 0.0 or abs(given[coefficient.partition(":")[0]] - given[parameter]) > _SET.agree * deviation:
            return False
    return True


def as_searched(effects: Effects, searched: Mapping[str, Searched], device: Device) -> dict[str, dict[str, float]]:
    """The effects, SI, their coefficients set to the parameters that are the same number and were searched for."""
    told = {name: dict(given) for name, given in effects.items()}
    for name, given in told.items():
        names = searched[name].names if name in searched else ()
        for parameter, coefficient in same_numbers(effect_for(name, device.axes, device.own)[1]).items():
            if parameter in names:
                given[coefficient.partition(":")[0]] = given[parameter]
    return told


def _deviation(model: Fitted, coefficient: str) -> float:
    row = model.observer.estimated.index(coefficient)
    return float(np.sqrt(model.observer.covariance[row, row]))
