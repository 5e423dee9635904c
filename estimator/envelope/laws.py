"""What an effect does to the amplitude of a free vibration, averaged over a cycle.

For ẍ + x = F(x, ẋ) in scaled units, with x = a cos φ and ẋ = −a sin φ, the amplitude of a vibration that loses little
in a cycle follows a' = −⟨F sin φ⟩ (method of averaging: Krylov & Bogoliubov 1937; Nayfeh & Mook 1979, ch. 3).  A force
c f(x, ẋ) that is homogeneous of degree p then gives

    a' = −c K aᵖ,   K = (1/2π) ∮ f(cos φ, −sin φ) sin φ dφ,

½ for damping, 2/π for dry friction, 4/(3π) for drag, ⅜ for the cube of the speed, ⅛ for x² ẋ.  f is taken from the
effect's declaration, where a smooth turn of sign (tanh) is a sharp one: a vibration is fast but for its turning points.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import sympy as sp

from estimator.effects.catalogue import EFFECTS
from estimator.effects.declaration import Coefficient, Effect, Source
from estimator.model.gyro import vx, x

LINEAR = 0.5
"""K of damping that is proportional to the velocity, whose degree is 1."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
_POINTS = ((0.31, 0.83), (-0.57, 0.44), (0.72, -0.21), (-0.36, -0.95))  # where degrees are compared
_SAME = 1e-9  # of a value: rounding
_NONE = 1e-12  # of an average: what a symmetry takes to zero


@dataclass(frozen=True)
class Law:
    """An effect in the equation of the amplitude: a' = −c `size` a^`degree`, scaled, c the effect's one coefficient."""

    effect: Effect
    size: float
    degree: float

    @property
    def coefficient(self) -> Coefficient:
        """The only one."""
        return self.effect.coefficients[0]

    @property
    def equation(self) -> str:
        """In SI; ω0 the resonance, in rad/s."""
        power = 1 + self.coefficient.time
        sign, size = ("*", power) if power > 0 else ("/", -power)
        omega = "" if power == 0 else f"{sign}omega0" if size == 1 else f"{sign}omega0**{size}"
        amplitude = "" if self.degree == 0 else "*a" if self.degree == 1 else f"*a**{self.degree:.4g}"
        return f"ȧ += -{self.size:.4g}*{self.coefficient.symbol}{omega}{amplitude}"


def laws(own: Iterable[Effect] = ()) -> Mapping[str, Law]:
    """The effects of the catalogue, and those of one's `own`, that take energy as a power of the amplitude, by name."""
    every = (effect for effect in (*EFFECTS, *own) if not effect.rare)
    return {effect.name: law for effect in every if (law := _law_of(effect)) is not None}


def _law_of(effect: Effect) -> Law | None:
    """None for what has no such law: it depends on the past, on time or on a drive, acts on the reading, takes no
    energy, or is no power.
    """
    alone = effect.on(1)
    if alone is None or len(alone.coefficients) != 1 or alone.delayed is not None or alone.sense[0] != 0:
        return None
    sharp = {signal.symbol: sp.sign(vx) for signal in alone.signals if signal.source is Source.DIRECTION}
    force = sp.sympify(alone.force[0]).subs(sharp).replace(sp.tanh, sp.sign)
    symbol = alone.coefficients[0].symbol
    if not force.free_symbols <= {x, vx, symbol}:
        return None
    one = sp.lambdify((x, vx), force.subs(symbol, 1), "numpy")
    two = sp.lambdify((x, vx), force.subs(symbol, 2), "numpy")
    at, speed = np.array(_POINTS).T
    values = np.broadcast_to(one(at, speed), at.shape)
    if not np.allclose(np.broadcast_to(two(at, speed), at.shape), 2.0 * values, rtol=_SAME):
        return None
    ratio = np.broadcast_to(one(2.0 * at, 2.0 * speed), at.shape) / np.where(values == 0.0, np.nan, values)
    degree = float(np.log2(ratio[0])) if ratio[0] > 0.0 else np.nan
    if not np.allclose(ratio, 2.0**degree, rtol=_SAME):
        return None
    size = _average(one)
    return Law(alone, size, round(degree, 9)) if abs(size) > _NONE and degree != 1.0 else None


def _average(force: object) -> float:
    """K of a force; by quarters of a cycle, since x and ẋ change their signs between them."""
    quarters = 0.25 * np.pi * (_NODES + 1.0) + 0.5 * np.pi * np.arange(4)[:, None]
    assert callable(force)
    values = force(np.cos(quarters), -np.sin(quarters)) * np.sin(quarters)
    return float(np.sum(values * _WEIGHTS) * 0.25 * np.pi / (2.0 * np.pi))
