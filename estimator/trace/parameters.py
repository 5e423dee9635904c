"""A frequency, a corner or a threshold that an effect has and no filter estimates: moved to where the likelihood is
largest, and how surely it is there.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.settings import ControllerSettings, Device
from estimator.trace.fitting import Fitted, coefficients_of, fit
from estimator.trace.record import Record

_ROUNDS = 6
_SHARE = 0.1  # first step of a threshold, a corner or a damping ratio
_BIN = 0.5  # first step of a frequency, over the record's length
_NEAR = 0.1  # standard deviations from the top of the parabola: near enough
_FINE = 3.0  # standard deviations of a step over which the likelihood is a parabola
_SEEN = 0.5  # of twice the log-likelihood: less says nothing


@dataclass(frozen=True)
class Searched:
    """How surely a parameter was found: its standard deviation, and what one unit of it moves each coefficient by."""

    deviation: float
    moves: Mapping[str, float]


def refine_parameters(
    record: Record,
    device: Device,
    controller: ControllerSettings | None,
    model: Fitted,
    name: str,
    before: Mapping[str, Searched] = MappingProxyType({}),
) -> tuple[Fitted, dict[str, Searched]]:
    """`model` with the parameters of its effect `name` improved one after the other, twice where there are several.

    before: how surely they were found earlier, with less of the record or fewer effects.
    """
    _, effect = effect_for(name, device.axes)
    given = model.settings.effects[name]
    names = [p.name for p in effect.parameters if p.name in given]
    searched = dict(before)
    for _ in range(1 if before else min(len(names), 2)):
        for which in names:
            now = model.settings.effects[name][which]
            alone = which == "omega" and len(names) == 1
            width = _BIN / float(np.sum(record.step)) if alone else _SHARE * now
            if which in searched and searched[which].deviation > 0.0:
                width = min(width, _FINE * searched[which].deviation)
            trial = _trial(record, device, controller, name, which)
            model, searched[which] = _climb(trial(model, now), name, which, width, trial)
    effects = coefficients_of(model.observer)
    return (fit(record, device, model.settings, controller, effects) if names else model), searched


Trial = Callable[[Fitted, float], Fitted]


def _trial(record: Record, device: Device, controller: ControllerSettings | None, name: str, which: str) -> Trial:
    def fitted_at(model: Fitted, value: float) -> Fitted:
        # One pass from a wide start, for all alike: the likelihood of a second pass has less of the start in it.
        effects = {effect: dict(given) for effect, given in model.settings.effects.items()}
        effects[name][which] = value
        return fit(record, device, model.settings, controller, effects, passes=1)

    return fitted_at


def _climb(model: Fitted, name: str, which: str, width: float, trial: Trial) -> tuple[Fitted, Searched]:
    """Steps uphill, twice as long each, until both sides are lower; then to the top of the parabola through the three,
    with steps of a few standard deviations.
    """
    deviation, moves = 0.0, dict.fromkeys(_coefficients(model, name), 0.0)
    seen: dict[float, Fitted] = {}

    def at(value: float) -> Fitted:
        if value not in seen:
            seen[value] = trial(model, value)
        return seen[value]

    for _ in range(_ROUNDS):
        now = model.settings.effects[name][which]
        width = min(width, 0.5 * now)
        low, high = at(now - width), at(now + width)
        if not np.isfinite(low.likelihood) or not np.isfinite(high.likelihood):
            width *= 0.25
            continue
        curvature = 2.0 * model.likelihood - low.likelihood - high.likelihood
        better = max(low, high, key=lambda fitted: fitted.likelihood)
        if better.likelihood > model.likelihood + _SEEN:
            model, width = better, 2.0 * width
            continue
        if curvature < _SEEN:
            if width >= 0.5 * now:
                break
            width *= 3.0
            continue
        deviation = width * float(np.sqrt(2.0 / curvature))
        below, above = _coefficients(low, name), _coefficients(high, name)
        moves = {symbol: (above[symbol] - below[symbol]) / (2.0 * width) for symbol in below}
        shift = 0.5 * width * (high.likelihood - low.likelihood) / curvature
        if abs(shift) > _NEAR * deviation:
            top = at(now + shift)
            model = top if top.likelihood > model.likelihood else model
        elif width < 2.0 * _FINE * deviation:
            break
        width = min(_FINE * deviation, 0.5 * width)
    return model, Searched(deviation, moves)


def _coefficients(model: Fitted, name: str) -> dict[str, float]:
    _, effect = effect_for(name, model.observer.device.axes)
    bare = {c.name.partition(":")[0] for c in effect.coefficients}
    return {symbol: value for symbol, value in coefficients_of(model.observer)[name].items() if symbol in bare}
