"""All effects, numbered: the number is what a compiled kernel dispatches on."""

from estimator.effects import damping, drive, sense, stiffness
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
)


def names() -> tuple[str, ...]:
    """Names of all effects."""
    return tuple(effect.name for effect in EFFECTS)


def effect_for(name: str, axes: int) -> tuple[int, Effect]:
    """Number and declaration of an effect on a device with that many axes.

    Raises ModelError for an unknown name, and for an effect of which a single axis has nothing.
    """
    if name not in names():
        raise ModelError(f"no effect {name!r}; known: {', '.join(names())}")
    number = names().index(name)
    effect = EFFECTS[number].on(axes)
    if effect is None:
        raise ModelError(f"effect {name!r} needs two axes")
    return number, effect
