"""What a fitted model has, as it is told: constants and effects in SI, coefficients with their intervals."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from estimator.diagnosis import Found, Interval
from estimator.effects.declaration import Effect, name_of
from estimator.effects.equation import equations_on
from estimator.effects.labels import kind
from estimator.trace.angle import AngleReader
from estimator.trace.checks import Evidence
from estimator.trace.fit import FittedModel
from estimator.trace.problem import Effects


def effects_of(fitted: FittedModel) -> dict[str, dict[str, float]]:
    """Effects with coefficients and parameters, SI."""
    layout, model = fitted.layout, fitted.model
    effects = {name: dict(given) for name, given in layout.effects_of(model).items()}
    for k, (owner, name) in enumerate(zip(layout.owner, layout.names, strict=True)):
        if owner:
            effects[owner][name.partition(":")[0]] = float(model.theta[k] * layout.factor[k])
    return effects


def constants_of(fitted: FittedModel) -> dict[str, float]:
    """Constants of the base model, SI."""
    layout, theta = fitted.layout, fitted.model.theta
    return {layout.names[k]: float(theta[k] * layout.factor[k]) for k in layout.constants}


def called(name: str, named: Iterable[str]) -> str:
    """An effect's name; its label stays where several of the kind are named."""
    return name if sum(kind(other) == kind(name) for other in named) > 1 else kind(name)


def intervals_of(effect: Effect, model: FittedModel, name: str) -> dict[str, Interval]:
    """Coefficients and searched parameters of an effect of a model, SI, with their 95 % intervals."""
    names = model.layout.names
    units = {c.name: c.unit for c in effect.coefficients} | {p.name: p.unit for p in effect.parameters}
    return {kind(names[k]): model.interval(k, units[names[k]]) for k in model.layout.of(name)}


def found_of(name: str, evidence: Evidence, carried: Effects, reader: AngleReader) -> Found:
    """An effect as it is told."""
    model, effect = evidence.model, evidence.of.effect(name)
    assert isinstance(effect, Effect)
    layout, spread, places = model.layout, model.covariance, model.layout.of(name)
    intervals = intervals_of(effect, model, name)
    if evidence.held_out.records:  # what each of several has of its own is none of the device's
        each = {kind(c.name) for c in effect.coefficients if c.own}
        intervals = {symbol: one for symbol, one in intervals.items() if symbol not in each}
    for parameter in effect.parameters:
        if (coefficient := name_of(parameter, "found_as")) and parameter.name in carried[name]:
            # The same number as a coefficient, which is as sure.
            same = intervals[coefficient]
            intervals[parameter.name] = replace(same, value=carried[name][parameter.name], unit=parameter.unit)
    own = places[: len(effect.coefficients)]
    in_si = spread[np.ix_(own, own)] * np.outer(layout.factor[own], layout.factor[own])
    return Found(
        name=called(name, evidence.without), title=effect.title, equation=equations_on(effect, evidence.of.axes),
        coefficients=intervals,
        evidence=2.0 * (model.objective - evidence.without[name].objective), compensation=effect.compensation.value,
        angle_bound=reader.bound(carried, name, in_si) if evidence.of.axes == 2 else None,
    )  # fmt: skip
