"""A parameter that is the same number as one of the effect's coefficients: a corner that is also a size.

Where the coefficient is well determined, the parameter follows from it.  On a calm record it need not be: what a
high-pass does to a steady vibration is a delay, and its corner shows in how its start wanes; then the parameter is
searched for, and the coefficient has to agree with it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.effects.declaration import Effect
from estimator.settings import Device
from estimator.thresholds import THRESHOLDS
from estimator.trace.fitting import Fitted, coefficients_of, fit, is_as_predicted, widening
from estimator.trace.problem import Problem
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
            return model, is_as_predicted(model) and all(value > 0.0 for value in found.values())
        again = problem.under(model.settings).carrying({**effects, name: {**given, **moved}})
        following = fit(again, passes=1, about=model.observer)
        if not following.likelihood > model.likelihood - _SET.rough_start:
            return model, False
        model = following
    return model, False


def agree(problem: Problem, model: Fitted, name: str, searched: Searched) -> bool:
    """Whether each coefficient is what its parameter was found to be, as far as both are known."""
    pairs = _pairs(problem.device, model, name, searched)
    apart = [
        abs(pair.coefficient - pair.parameter) <= _SET.agree * np.hypot(pair.deviation, pair.own_deviation)
        for pair in pairs.values()
        if pair.own_deviation > 0.0
    ]
    return len(apart) == len(searched.names) and all(apart)


def surer(device: Device, model: Fitted, name: str, searched: Searched) -> dict[str, str]:
    """By coefficient the parameter that is the same number and is known better, as a search found it."""
    return {
        symbol: pair.name
        for symbol, pair in _pairs(device, model, name, searched).items()
        if 0.0 < pair.own_deviation < pair.deviation
    }


def effects_of(model: Fitted, searched: Mapping[str, Searched]) -> dict[str, dict[str, float]]:
    """The effects of a model, SI; what is one number is the one of the two that is known better."""
    device, found = model.observer.device, coefficients_of(model.observer)
    for name in searched.keys() & found.keys():
        better = surer(device, model, name, searched[name])
        for symbol, pair in _pairs(device, model, name, searched[name]).items():
            to, of = (symbol, pair.name) if symbol in better else (pair.name, symbol)
            found[name][to] = found[name][of]
    return found


@dataclass(frozen=True)
class _Pair:
    """A coefficient and the parameter of that name that is the same number, SI, each with its standard deviation."""

    name: str
    coefficient: float
    deviation: float
    parameter: float
    own_deviation: float


def _pairs(device: Device, model: Fitted, name: str, searched: Searched) -> dict[str, _Pair]:
    """By the coefficient's symbol, of the parameters that were searched for."""
    _, effect = effect_for(name, device.axes, device.own)
    given, symbols = coefficients_of(model.observer)[name], [c.name for c in effect.coefficients]
    wider, pairs = widening(model), {}
    for parameter, coefficient in same_numbers(effect).items():
        if parameter not in searched.names:
            continue
        moves = searched.moves[symbols.index(coefficient)]
        deviation = float(np.sqrt(_deviation(model, coefficient) ** 2 + moves @ searched.covariance @ moves))
        symbol = coefficient.partition(":")[0]
        own = searched.deviation(parameter)
        pairs[symbol] = _Pair(parameter, given[symbol], wider * deviation, given[parameter], wider * own)
    return pairs


def _deviation(model: Fitted, coefficient: str) -> float:
    row = model.observer.estimated.index(coefficient)
    return float(np.sqrt(model.observer.covariance[row, row]))
