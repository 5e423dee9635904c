"""What an effect is: a force, a distortion of the measurement, or both, that the base model lacks.

Declared in SymPy over the states and drives of the two-axis gyro; on a single axis y, ẏ and uy are zero and the
coefficients that then act on nothing drop out.  All that is known of an effect stands in its declaration: equation,
units, plausible sizes, what it looks like, what undoes it, and where it comes from.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import sympy as sp

from estimator.model.gyro import ux, uy, vx, vy, x, y


class Undone(Enum):
    """How an effect is kept out of the angle once its coefficients are known."""

    CANCEL = "the control law subtracts its force"
    INVERT = "the control law divides by it"
    MAP = "the observer's state has it taken out of the measurement"


@dataclass(frozen=True)
class Coefficient:
    """A number an effect has.

    length, time: powers of metre and second in its SI unit, per unit mass; plausible: its largest likely size in scaled
    units (amplitude 1, ω0 1), the standard deviation with which it enters an observer; positive: a negative value would
    be no such effect (friction that drives).
    """

    symbol: sp.Symbol
    name: str
    plausible: float
    length: int = 0
    time: int = 0
    positive: bool = False

    @property
    def unit(self) -> str:
        """The SI unit."""
        powers = [(name, power) for name, power in (("m", self.length), ("s", self.time)) if power]
        above = "·".join(name + _superscript(power) for name, power in powers if power > 0)
        below = "·".join(name + _superscript(-power) for name, power in powers if power < 0)
        return (above or "1") + (f"/({below})" if "·" in below else f"/{below}" if below else "")


@dataclass(frozen=True)
class Effect:
    """Force per unit mass added to (ẍ, ÿ), and displacement added to what each axis senses, in scaled units.

    `force` may depend on states, drives and coefficients, `sense` on the same; both are zero where not given.
    """

    name: str
    title: str
    coefficients: tuple[Coefficient, ...]
    source: str
    signature: str
    undone: Undone
    force: tuple[sp.Expr, sp.Expr] = (sp.Integer(0), sp.Integer(0))
    sense: tuple[sp.Expr, sp.Expr] = (sp.Integer(0), sp.Integer(0))
    look_alikes: Mapping[str, str] = field(default_factory=dict)

    def on(self, axes: int) -> "Effect | None":
        """The effect on a device with that many axes, None where nothing of it is left."""
        if axes == 2:
            return self
        absent = {y: 0, vy: 0, uy: 0}
        force = sp.sympify(self.force[0]).subs(absent)
        sense = sp.sympify(self.sense[0]).subs(absent)
        left = tuple(c for c in self.coefficients if c.symbol in force.free_symbols | sense.free_symbols)
        if not left:
            return None
        zero = sp.Integer(0)
        return Effect(
            self.name,
            self.title,
            left,
            self.source,
            self.signature,
            self.undone,
            (force, zero),
            (sense, zero),
            self.look_alikes,
        )


STATES = (x, vx, y, vy)
DRIVES = (ux, uy)


def _superscript(power: int) -> str:
    return "" if power == 1 else str(power).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))
