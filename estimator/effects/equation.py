"""An effect's equations as a reader expects them."""

from estimator.effects.declaration import Delayed, Effect, name_of


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
    import sympy as sp

    lines = []
    for expressions, left in ((effect.force, "{axis}̈ += {term}"), (effect.sense, "sensed {axis} += {term}")):
        for axis, expression in zip("xy", expressions, strict=True):
            if expression != 0:
                lines.append(left.format(axis=axis, term=sp.sstr(expression)))
    return tuple(lines)
