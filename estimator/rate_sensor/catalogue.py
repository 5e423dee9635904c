"""All effects of a rate sensor."""

from estimator.errors import ModelError
from estimator.rate_sensor import characteristic, dynamics, surroundings
from estimator.rate_sensor.declaration import Effect

EFFECTS: tuple[Effect, ...] = (
    characteristic.SATURATION,
    characteristic.SOFT_SATURATION,
    characteristic.FOLD_BACK,
    characteristic.CUBIC,
    characteristic.QUADRATIC,
    characteristic.SCALE_ASYMMETRY,
    characteristic.DEAD_BAND,
    characteristic.HYSTERESIS,
    dynamics.LAG,
    dynamics.SECOND_ORDER,
    dynamics.DELAY,
    dynamics.MOVING_MEAN,
    dynamics.REFERENCE_LAG,
    dynamics.REFERENCE_NOISE,
    surroundings.DRIFT,
    surroundings.TEMPERATURE_OFFSET,
    surroundings.TEMPERATURE_SCALE,
)


def names() -> tuple[str, ...]:
    """Names of all effects."""
    return tuple(effect.name for effect in EFFECTS)


def effect_for(name: str) -> Effect:
    """Declaration of an effect by name; ModelError for an unknown one."""
    for effect in EFFECTS:
        if effect.name == name:
            return effect
    raise ModelError(f"no effect {name!r} of a rate sensor; known: {', '.join(names())}")
