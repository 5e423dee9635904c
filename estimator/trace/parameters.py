"""A frequency or a threshold that an effect has and no filter estimates: moved to where the likelihood is largest."""

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.settings import ControllerSettings, Device, ObserverSettings
from estimator.trace.fitting import Fitted, coefficients_of, fit
from estimator.trace.record import Record

_ROUNDS = 12
_SHARE = 0.1  # first step of a threshold or a damping ratio
_FINEST = 0.02  # of the first step


def refine_parameters(
    record: Record,
    device: Device,
    settings: ObserverSettings,
    controller: ControllerSettings | None,
    model: Fitted,
    name: str,
) -> Fitted:
    """`model` with the parameters of its effect `name` improved one after the other, `settings` as declared.

    A frequency alone is moved within what the record's length leaves open, everything else by tenths.
    """
    _, effect = effect_for(name, device.axes)
    if name.partition(":")[0] == "sense_high_pass":
        return _at_its_own_corner(record, device, settings, controller, model, name)
    for parameter in effect.parameters:
        alone = parameter.name == "omega" and len(effect.parameters) == 1
        now = model.settings.effects[name][parameter.name]
        width = 0.5 / float(np.sum(record.step)) if alone else _SHARE * now
        model = _climb(record, device, controller, model, name, parameter.name, width)
    return model


def _climb(
    record: Record,
    device: Device,
    controller: ControllerSettings | None,
    model: Fitted,
    name: str,
    which: str,
    width: float,
) -> Fitted:
    """Pattern search along one parameter, with half the step where neither side is better."""
    first = width
    for _ in range(_ROUNDS):
        if width < _FINEST * first:
            break
        moved = False
        for sign in (1.0, -1.0):
            effects = {effect: dict(given) for effect, given in model.settings.effects.items()}
            effects[name][which] += sign * width
            if effects[name][which] <= 0.0:
                continue
            tried = fit(record, device, model.settings, controller, effects, passes=1)
            if tried.likelihood > model.likelihood:
                model, moved = tried, True
                break
        width *= 1.5 if moved else 0.4
    return model


def _at_its_own_corner(
    record: Record,
    device: Device,
    settings: ObserverSettings,
    controller: ControllerSettings | None,
    model: Fitted,
    name: str,
) -> Fitted:
    """A high-pass forgets at its own corner: the leak of each axis follows its estimated coefficient."""
    for _ in range(3):
        effects = coefficients_of(model.observer)
        for axis in "xy"[: device.axes]:
            effects[name][f"leak_{axis}"] = abs(effects[name][f"hp{axis}"])
        model = fit(record, device, settings, controller, effects)
    return model
