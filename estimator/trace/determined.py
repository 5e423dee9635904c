"""What a record says of the constants of the base model beyond what the bench file declares of them."""

import math
from collections.abc import Sequence

import numpy as np

from estimator.chance import TWO_SIDED
from estimator.scaling import Array
from estimator.trace.fit import FittedModel, beside


def undetermined(fitted: FittedModel) -> tuple[str, ...]:
    """A sentence on the constants of which the record says less than the bench file, and on what it says of them
    together; nothing where it says more of each.
    """
    layout = fitted.layout
    left = [k for k in layout.constants if _of_the_record(fitted, [k])[0, 0] < 1.0]
    if not left:
        return ()
    said = not_determined([layout.names[k] for k in left])
    together = _together(fitted, left)
    return (f"{said}; it does determine {together}" if together else said,)


def not_determined(names: Sequence[str]) -> str:
    """What is said of constants of which the record says less than the bench file."""
    each, values = ("it", "its value stands") if len(names) == 1 else ("each", "their values stand")
    listed = " and ".join(", ".join(names).rsplit(", ", 1))
    return f"the record does not determine {listed}: it says less of {each} than the bench file, and {values}"


def _of_the_record(fitted: FittedModel, places: list[int]) -> Array:
    """Information of the record by itself on these parameters, whatever the others are, in units of their priors."""
    rest = [k for k in range(len(fitted.layout.names)) if k not in places]
    information = fitted.evaluation.information.sum(axis=0) / fitted.evaluation.scale
    size = fitted.layout.deviation[places]
    return beside(information, places, rest)[0] * np.outer(size, size)


def _together(fitted: FittedModel, places: list[int]) -> str | None:
    """The product of powers of these that the record knows best, with how well; None where it knows none."""
    theta, layout = fitted.model.theta, fitted.layout
    places = [k for k in places if theta[k] != 0.0 and layout.mean[k] != 0.0]
    if len(places) < 2:
        return None
    values, directions = np.linalg.eigh(_of_the_record(fitted, places))
    if not values[-1] > 1.0:
        return None
    powers = directions[:, -1] * np.abs(theta[places]) / layout.deviation[places]
    most = int(np.argmax(np.abs(powers)))
    sure = 1.0 / (math.sqrt(float(values[-1])) * abs(float(powers[most])))
    powers = np.round(powers / powers[most], 1)
    factors = [_factor(layout.names[k], float(power)) for k, power in zip(places, powers, strict=True) if power]
    return f"{' × '.join(factors)}, to ± {TWO_SIDED * sure:.2g} of itself" if len(factors) > 1 else None


def _factor(name: str, power: float) -> str:
    return name if power == 1.0 else f"{name}^{power:g}".replace("-", "−")
