"""An effect's equations as a reader expects them."""

from estimator.effects.declaration import Delayed, Effect, name_of
from estimator.model.formula import as_declared, is_nothing, written

_OF_Y = ("ÿ", "y\u0308", "sensed y", "drive y")


def equations_on(effect: Effect, axes: int) -> tuple[str, ...]:
    """The same of a device with so many axes."""
    return tuple(line for line in equations(effect) if axes == 2 or not line.startswith(_OF_Y))


def equations(effect: Effect) -> tuple[str, ...]:
    """What the effect adds to each axis, a line each."""
    if effect.delayed is not None:
        what = "sensed" if effect.delayed is Delayed.SENSE else "drive"
        return tuple(
            f"{what} {axis}(t) → {axis}(t − {name_of(coefficient)})"
            for axis, coefficient in zip("xy", effect.coefficients, strict=False)
        )
    if effect.shown:
        return effect.shown
    laws = (as_declared(effect, "force"), "{axis}̈ += {term}"), (as_declared(effect, "sense"), "sensed {axis} += {term}")
    return tuple(
        left.format(axis=axis, term=written(expression))
        for expressions, left in laws
        for axis, expression in zip("xy", expressions, strict=True)
        if not is_nothing(expression)
    )
