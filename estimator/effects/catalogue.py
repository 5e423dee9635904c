"""All effects, numbered: the number is what a compiled kernel dispatches on."""

from collections.abc import Sequence

from estimator.effects import damping, delay, drive, equivalent, line, sense, stiffness, temperature
from estimator.effects.declaration import Effect
from estimator.errors import ModelError

EFFECTS: tuple[Effect, ...] = (
    stiffness.CUBIC_STIFFNESS,
    stiffness.CUBIC_ISOTROPIC,
    stiffness.QUADRATIC_STIFFNESS,
    stiffness.NONRECIPROCAL_STIFFNESS,
    damping.NONLINEAR_DAMPING,
    damping.DRY_FRICTION,
    sense.SENSE_GAIN,
    sense.SENSE_CROSS_COUPLING,
    sense.SENSE_QUADRATIC,
    sense.SENSE_CUBIC,
    sense.DRIVE_FEEDTHROUGH,
    drive.DRIVE_GAIN,
    drive.DRIVE_MISALIGNMENT,
    damping.DAMPING_ASYMMETRIC,
    damping.DRAG,
    damping.CUBIC_DAMPING,
    delay.SENSE_DELAY,
    delay.DRIVE_DELAY,
    damping.DRY_FRICTION_ASYMMETRIC,
    stiffness.CONSTANT_FORCE,
    sense.SENSE_LOW_PASS,
    sense.SENSE_HIGH_PASS,
    sense.SENSE_CLIPPING,
    sense.PARASITIC_MODE,
    drive.ELECTROSTATIC_DRIVE,
    drive.DRIVE_SATURATION,
    drive.DRIVE_DEAD_BAND,
    line.INTERFERENCE,
    line.BASE_VIBRATION,
    temperature.TEMPERATURE_STIFFNESS,
    temperature.TEMPERATURE_DAMPING,
    temperature.TEMPERATURE_OFFSET,
    equivalent.CLOCK_RATE,
    equivalent.UNEQUAL_MASSES,
    equivalent.DRIVE_POLARITY,
    equivalent.SENSE_POLARITY,
)


def names() -> tuple[str, ...]:
    """Names of all effects."""
    return tuple(effect.name for effect in EFFECTS)


OWN = -1
"""In place of the number of an effect that is not of this catalogue: `estimator.kernel.own` has its code."""


def effect_for(name: str, axes: int, own: Sequence[Effect] = ()) -> tuple[int, Effect]:
    """Number and declaration of an effect on a device with that many axes; `own` are those beside the catalogue.

    An effect that is there more than once has a label behind a colon, `interference:2`.

    Raises ModelError for an unknown name, and for an effect of which a single axis has nothing.
    """
    kind, _, label = name.partition(":")
    known = (*names(), *(effect.name for effect in own))
    if kind not in known:
        raise ModelError(f"no effect {kind!r}; known: {', '.join(known)}")
    index = known.index(kind)
    number = index if index < len(EFFECTS) else OWN
    effect = (*EFFECTS, *own)[index].on(axes)
    if effect is None:
        raise ModelError(f"effect {kind!r} needs two axes")
    return number, effect.labelled(label) if label else effect
