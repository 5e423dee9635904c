"""The two-axis gyro: equation (2) of TW I384198 B1 with the rotation terms, measurement (5)–(6).

    ẍ + dxx ẋ + dxy ẏ + kxx x + kxy y = ux + 2Ω ẏ + Ω² x
    ÿ + dxy ẋ + dyy ẏ + kxy x + kyy y = uy − 2Ω ẋ + Ω² y

The Euler term Ω̇ has no place in a vector field with constant Ω; it enters through the jump of Ω (see `Constant.jump`).
"""

from typing import Any

from estimator.model import symbols
from estimator.model.declaration import Constant, Model, Quantity, State
from estimator.model.formula import in_sympy

_KNOWN = ("x", "vx", "y", "vy", "phi_x", "phi_y", "rate", "kxx", "kyy", "kxy", "dxx", "dyy", "dxy", "ux", "uy")


def __getattr__(name: str) -> Any:
    """The model's symbols, for those who calculate with them: SymPy's own, which loads it."""
    if name not in _KNOWN:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return in_sympy(getattr(symbols, name))


def _declared() -> Model:
    x, vx, y, vy, phi_x, phi_y, rate, kxx, kyy, kxy, dxx, dyy, dxy, ux, uy = (getattr(symbols, s) for s in _KNOWN)
    return Model(
        name="gyro",
        axes=2,
        states=(
            State(x, "x", Quantity.POSITION),
            State(vx, "vx", Quantity.VELOCITY),
            State(y, "y", Quantity.POSITION),
            State(vy, "vy", Quantity.VELOCITY),
        ),
        sense_constants=(
            Constant(phi_x, "phi_x", Quantity.OFFSET),
            Constant(phi_y, "phi_y", Quantity.OFFSET),
        ),
        flow_constants=(
            Constant(rate, "rate", Quantity.RATE, jump={vx: y, vy: -x}),
            Constant(kxx, "kxx", Quantity.STIFFNESS),
            Constant(kyy, "kyy", Quantity.STIFFNESS),
            Constant(kxy, "kxy", Quantity.STIFFNESS),
            Constant(dxx, "dxx", Quantity.DAMPING),
            Constant(dyy, "dyy", Quantity.DAMPING),
            Constant(dxy, "dxy", Quantity.DAMPING),
        ),
        inputs=(ux, uy),
        field=(
            vx,
            -dxx * vx - dxy * vy - kxx * x - kxy * y + ux + 2 * rate * vy + rate**2 * x,
            vy,
            -dxy * vx - dyy * vy - kxy * x - kyy * y + uy - 2 * rate * vx + rate**2 * y,
        ),
        measurement=(x + phi_x, y + phi_y),
    )


GYRO = _declared()
