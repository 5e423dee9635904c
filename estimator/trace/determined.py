"""What a record says of the constants of a free run beyond what the bench file declares of them."""

import math
from collections.abc import Sequence

import numpy as np

from estimator.chance import TWO_SIDED
from estimator.observer import Observer
from estimator.refinement import Declared, Refined
from estimator.scaling import Array


def declared(observer: Observer) -> dict[str, Declared]:
    """The constants of the base model as the observer begins with them: stiffness, damping, gains, offsets, rate."""
    spread = np.sqrt(np.diagonal(observer.covariance))
    return {
        name: Declared(float(observer.state[observer.names.index(name)]), float(spread[number]))
        for number, name in enumerate(observer.estimated)
        if name in observer.model.names[observer.states :]
    }


def unsettled(observer: Observer) -> tuple[str, ...]:
    """What a free run may change of all that the observer estimates: not what the bench file declares exactly, a known
    drive gain.  An offset is fitted anyhow: every sensor has one, and few bench files say so.
    """
    exact = {name for name, one in declared(observer).items() if one.deviation == 0.0}
    offsets = {constant.name for constant in observer.model.sense_constants}
    return tuple(name for name in observer.estimated if name not in exact or name in offsets)


def undetermined(fit: Refined) -> tuple[str, ...]:
    """A sentence on the constants of which the record says less than the bench file, and on what it says of them
    together; nothing where it says more of each.
    """
    left = [name for name in fit.known if _own(fit, (name,))[0, 0] < 1.0]
    if not left:
        return ()
    said = f"{not_determined(left)}, whose value stands"
    together = _together(fit, left)
    return (f"{said}; it does determine {together}" if together else said,)


def not_determined(names: Sequence[str]) -> str:
    """What is said of constants of which the record says less than the bench file."""
    each = "it" if len(names) == 1 else "each"
    return f"the record does not determine {_listed(names)}: it says less of {each} than the bench file"


def _own(fit: Refined, names: Sequence[str]) -> Array:
    """Information on these, whatever the others are, in units of what is declared of them."""
    at = [fit.free.index(name) for name in names]
    rest = [i for i in range(len(fit.free)) if i not in at]
    size = np.array([fit.known[name].deviation for name in names])
    information = fit.information[np.ix_(at, at)]
    if rest:
        others = fit.information[np.ix_(rest, rest)]
        cross = fit.information[np.ix_(at, rest)]
        scale = np.sqrt(np.maximum(np.diagonal(others), np.finfo(float).tiny))
        inverse = np.linalg.pinv(others / np.outer(scale, scale)) / np.outer(scale, scale)
        information = information - cross @ inverse @ cross.T
    return np.asarray(information * np.outer(size, size))


def _together(fit: Refined, names: Sequence[str]) -> str | None:
    """The product of powers of these that the record knows best, with how well; None where it knows none."""
    names = [name for name in names if fit.value(name) != 0.0 and fit.known[name].value != 0.0]
    if len(names) < 2:
        return None
    values, directions = np.linalg.eigh(_own(fit, names))
    if not values[-1] > 1.0:
        return None
    relative = np.array([fit.known[name].deviation / abs(fit.value(name)) for name in names])
    powers = directions[:, -1] / relative
    most = int(np.argmax(np.abs(powers)))
    sure = 1.0 / (math.sqrt(float(values[-1])) * abs(float(powers[most])))
    powers = powers / powers[most]
    factors = [(name, float(power)) for name, power in zip(names, powers, strict=True) if _counts(float(power))]
    if len(factors) < 2:
        return None
    product = " × ".join(_factor(name, power) for name, power in factors)
    return f"{product}, to ± {TWO_SIDED * sure:.2g} of itself"


def _counts(power: float) -> bool:
    return _rounded(abs(power)) > 0.0


def _factor(name: str, power: float) -> str:
    power = math.copysign(_rounded(abs(power)), power)
    return name if power == 1.0 else f"{name}^{power:g}".replace("-", "−")


def _rounded(power: float) -> float:
    return round(power, 1)


def _listed(names: Sequence[str]) -> str:
    return " and ".join(", ".join(names).rsplit(", ", 1))
