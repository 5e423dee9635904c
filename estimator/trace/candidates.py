"""The catalogue beside a model: every effect that a record can show, those with parameters where the record suggests
them.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from estimator.effects.catalogue import EFFECTS
from estimator.effects.declaration import Effect, Parameter, Source
from estimator.effects.labels import kind
from estimator.effects.search import Search
from estimator.observer import senses_allow
from estimator.scaling import Scaling
from estimator.trace.likelihood import Evaluation
from estimator.trace.problem import Effects, Problem
from estimator.trace.start_values import Values, labelled, of_lines, of_modes, of_thresholds, rings

CORNERS = 2
"""Of a filter, evenly on a logarithmic scale from one over the record's length to the resonance; and as many lags from
a sample to a radian.  A fit goes on from there.
"""
SPEEDS = (0.01, 0.1)
"""Shares of the largest velocity below which a friction may be less than dry."""


def candidates(problem: Problem, included: Effects, seen: Evaluation, *, freely: bool = False) -> Effects:
    """Effects that are not in the model, each with its parameters, SI; with a label where it has several starts.

    A line or a mode may be there more than once; what is searched for as an included effect is, begins where that one
    is too: it may be in its place. freely: of a single axis, with what only a free run can show.
    """
    starts = _starts(problem, seen)
    kinds = {kind(name) for name in included}
    found = {}
    for effect in _possible(problem, freely):
        several = effect.search in (Search.LINES, Search.MODES, Search.RINGS)
        if effect.name in kinds and not several:
            continue
        for label, given in (*_given(problem, effect, starts), *_in_place_of(effect, included)):
            name = f"{effect.name}:{label}" if label else effect.name
            if name not in included:
                found[name] = given
    return found


def _in_place_of(effect: Effect, included: Effects) -> Iterator[tuple[str, dict[str, float]]]:
    """The effect at the parameters of those in the model that are searched for alike."""
    names = [parameter.name for parameter in effect.parameters]
    for name, given in included.items():
        other = next((one for one in EFFECTS if one.name == kind(name)), None)
        if other is None or other is effect or effect.search is None or other.search is not effect.search:
            continue
        values = [given[parameter.name] for parameter in other.parameters if parameter.name in given]
        if len(values) == len(names):
            yield f"for {name}", dict(zip(names, values, strict=True))


def _possible(problem: Problem, freely: bool) -> Iterator[Effect]:
    """What this device may have and this record may show."""
    record, device = problem.record, problem.device
    for effect in (*EFFECTS, *device.own):
        if effect.declared_only or effect.on(device.axes) is None or not senses_allow(effect, device):
            continue
        if effect.runs_freely and not (freely and device.axes == 1):
            continue
        if effect.delayed is not None and not np.any(record.drive):
            continue
        if "temperature" not in record.channels and any(one.source is Source.TEMPERATURE for one in effect.signals):
            continue
        yield effect


def _starts(problem: Problem, seen: Evaluation) -> dict[Search, Values]:
    """Where the record suggests frequencies, corners and thresholds, SI."""
    record, device = problem.record, problem.device
    omega0 = float(np.sqrt(device.target))
    with np.errstate(invalid="ignore"):
        whitened = seen.innovation / seen.deviation
    return {
        Search.CORNERS: labelled(_between(1.0 / problem.span, omega0), 1.0),
        # The mean of a derivative over a lag is that at its half.
        Search.LAGS: [("", (0.0,)), *labelled(_between(float(np.mean(record.step)), 1.0 / omega0), 0.5)],
        Search.SPEEDS: labelled(SPEEDS, device.amplitude * omega0),
        Search.LINES: of_lines(record, device, whitened),
        Search.MODES: of_modes(record, device, whitened),
        Search.RINGS: [
            (str(label), ring)
            for label, ring in enumerate(rings([seen.innovation], device.sample_rate, omega0), start=1)
        ],
        **of_thresholds(record, device),
    }


def _between(least: float, most: float) -> list[float]:
    """So many numbers between two."""
    return [float(value) for value in np.geomspace(least, most, CORNERS + 2)[1:-1]]


def _given(problem: Problem, effect: Effect, starts: dict[Search, Values]) -> Iterator[tuple[str, dict[str, float]]]:
    """The effect's parameters at each of its starts, with a label."""
    names = [parameter.name for parameter in effect.parameters]
    if effect.search is Search.RINGS:
        names = [coefficient.name for coefficient in effect.coefficients[:2]]
    if effect.search is Search.LAGS:
        here = effect.on(problem.device.axes) or effect
        names = [coefficient.name for coefficient in here.coefficients if coefficient.bent]
    if not names:
        yield "", {}
    elif effect.search is not None:
        for label, values in starts.get(effect.search, []):
            yield label, dict(zip(names, values * len(names) if len(values) == 1 else values, strict=True))
    else:
        scaling = Scaling.of(problem.device)
        for number, values in enumerate(product(*(_tried(p) for p in effect.parameters)), start=1):
            pairs = zip(effect.parameters, values, strict=True)
            yield str(number), {p.name: value * scaling.coefficient(p) for p, value in pairs}


def _tried(parameter: Parameter) -> tuple[float, ...]:
    """Where the declaration has a search begin, scaled."""
    return parameter.tried or ((parameter.default,) if parameter.default is not None else ())
