"""Which characteristic of the device an effect is a law of: what a channel reads of a displacement, what an axis gets
of its drive, the spring, the damping.

A characteristic is one curve.  Laws of it are terms of a series: with enough of them any curve is matched, whatever
made it.
"""

from enum import Enum

from estimator.effects.declaration import Effect, Source
from estimator.model.gyro import ux, vx, x


class Characteristic(Enum):
    """A curve that the base model takes to be a straight line; a gain is its slope, and no law of its shape."""

    SENSE = "what a channel reads of the displacement"
    DRIVE = "the force of the drive"
    SPRING = "the force of the spring"
    DAMPING = "the force of the damping"


def characteristic(effect: Effect) -> Characteristic | None:
    """The one that an effect is a law of, by what its equation depends on; None where that is something else than the
    same axis now: another axis, the time, the temperature, the way that the mass came.
    """
    direction = {signal.symbol for signal in effect.signals if signal.source is Source.DIRECTION}
    others = {signal.symbol for signal in effect.signals if signal.source not in (Source.DIRECTION, Source.PARAMETER)}
    sensed, pushed = effect.sense[0].free_symbols, effect.force[0].free_symbols
    if (
        effect.gain
        or effect.delayed is not None
        or effect.declared_only
        or (sensed and pushed)
        or (sensed | pushed) & others
    ):
        return None
    if sensed:
        return Characteristic.SENSE if x in sensed and not sensed & {vx, ux} else None
    if ux in pushed:
        return Characteristic.DRIVE if not pushed & {x, vx} else None
    if pushed & ({vx} | direction):
        return Characteristic.DAMPING
    return Characteristic.SPRING if x in pushed else None
