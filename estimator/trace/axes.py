"""An effect as it is shown of a device with so many axes."""

from estimator.effects.declaration import Effect
from estimator.effects.equation import equations

_OF_Y = ("ÿ", "y\u0308", "sensed y", "drive y")


def equations_on(effect: Effect, axes: int) -> tuple[str, ...]:
    """What the effect adds, a line each, less those of an axis that the device does not have."""
    return tuple(line for line in equations(effect) if axes == 2 or not line.startswith(_OF_Y))
