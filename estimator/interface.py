"""Sense interfaces by name: the map from the motion to what a channel shows, over the gain at rest.

A map has one constant for each axis. Its law, in the grammar of `estimator.custom`, is carried by the observer as a
known effect on the measurement: offset, control and angle need nothing of their own. Beside it stand the map in
numbers, its derivative, its inverse and its noise over that at rest.

    gap_closing     x/(1 − (x/Z)²)          Senturia, Microsystem Design, 2001, ch. 6: 1/(Z − x) − 1/(Z + x)
    optical         x (1 + κ r²)            Brown, Photogrammetric Engineering 37 (1971): the first radial term
    piezoresistive  x (1 + α (T − T0))      Kanda, IEEE Trans. Electron Devices 29 (1982): the gauge factor over T
    piezoelectric   ẋ behind 1/(1 + s/ωc)   Rf Cf of the current amplifier, at ω0, where the loop holds the vibration
    tunnelling      (exp(a x) − 1)/a        Simmons, J. Appl. Phys. 34 (1963); its shot noise goes with √exp(a x)
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

Array = Any  # (n,) of float
Kind = Literal["comb", "gap_closing", "optical", "piezoresistive", "piezoelectric", "tunnelling"]
NAME = "sense_interface"
"""Of the effect that carries the map."""

_PHASES = np.cos(2.0 * np.pi * (np.arange(64) + 0.5) / 64)  # over a cycle


def _lens_inverse(s: Array, c: float) -> Array:
    """x of x + c x³ = s on the branch through rest, by Newton's method."""
    x = np.asarray(s, float)
    for _ in range(60):
        x = x - (x + c * x**3 - s) / np.maximum(1.0 + 3.0 * c * x**2, 1e-3)
    return x


class _Map(NamedTuple):
    """Of an axis with the constant c, whose unit is given.

    law: what is added to the displacement {x}; {o} is that of the other axis, {v} the velocity, {c} the constant.
    shown, slope, inverse: the map over the gain at rest, its derivative and its inverse, along the axis; c without a
    unit of its own, 1 K warmer of strain gauges, the corner over ω0 of a layer. noise: over that at rest. aside: what
    a displacement o of the other axis adds to what is shown.
    """

    law: str
    unit: str
    shown: Callable[[Array, float], Array]
    slope: Callable[[Array, float], Array]
    inverse: Callable[[Array, float], Array]
    noise: Callable[[Array, float], Array] = lambda x, c: 1.0
    aside: Callable[[Array, Array, float], Array] = lambda x, o, c: 0.0


MAPS: dict[str, _Map] = {
    "gap_closing": _Map(
        "{x}**3/({c}**2 - {x}**2)",
        "m",
        lambda x, c: x / (1.0 - (x / c) ** 2),
        lambda x, c: (1.0 + (x / c) ** 2) / (1.0 - (x / c) ** 2) ** 2,
        lambda s, c: 2.0 * s / (1.0 + np.sqrt(1.0 + 4.0 * (s / c) ** 2)),
    ),
    "optical": _Map(
        "{c}*{x}*({x}**2 + {o}**2)",
        "1/m^2",
        lambda x, c: x + c * x**3,
        lambda x, c: 1.0 + 3.0 * c * x**2,
        _lens_inverse,
        aside=lambda x, o, c: c * x * o**2,
    ),
    "piezoresistive": _Map(
        "{c}*T*{x}",
        "1/K",
        lambda x, c: x * (1.0 + c),
        lambda x, c: 1.0 + c,
        lambda s, c: s / (1.0 + c),
    ),
    "piezoelectric": _Map(
        "-{x}*omega0**2/({c}**2 + omega0**2) - {v}*{c}/({c}**2 + omega0**2)",
        "1/s",
        lambda x, c: x / math.hypot(1.0, 1.0 / c),
        lambda x, c: 1.0 / math.hypot(1.0, 1.0 / c),
        lambda s, c: s * math.hypot(1.0, 1.0 / c),
    ),
    "tunnelling": _Map(
        "(exp({c}*{x}) - 1)/{c} - {x}",
        "1/m",
        lambda x, c: np.expm1(c * x) / c,
        lambda x, c: np.exp(c * x),
        lambda s, c: np.log1p(c * s) / c,
        lambda x, c: np.exp(0.5 * c * x),
    ),
}
"""By kind; a comb capacitor has none."""

assert {"comb", *MAPS} == set(get_args(Kind))


@dataclass(frozen=True)
class Interface:
    """One interface: its kind, its constant of each axis in SI (none of a comb), the target frequency [rad/s]."""

    kind: Kind
    constants: tuple[float, ...]
    omega0: float

    def laws(self) -> tuple[list[str], dict[str, tuple[str, float]]]:
        """What is added to the displacement of each axis, and unit and value of each constant by name; empty where
        the map adds nothing.
        """
        axes = "xy"[: len(self.constants)]
        laws, constants = ["", ""], {}
        for axis, (letter, value) in enumerate(zip(axes, self.constants, strict=True)):
            if value == 0.0:  # adds nothing, and other laws divide by it
                continue
            name = f"{NAME}_{letter}"
            constants[name] = (MAPS[self.kind].unit, value)
            other = axes.replace(letter, "") or "0"
            laws[axis] = MAPS[self.kind].law.format(x=letter, o=other, v=f"v{letter}", c=name)
        return laws, constants

    def shown(self, axis: int, x: Array) -> Array:
        """What a displacement x (n,) [m] along the axis shows, over the gain at rest [m]; of a layer the amplitude."""
        return self._of("shown", axis, x)

    def channels(self, x: float, y: float) -> Array:
        """What a displacement (x, y) [m] shows on both axes (2,), over the gain at rest [m]."""
        along = np.array([self.shown(axis, one) for axis, one in enumerate((x, y))])
        if not self.constants:
            return along
        pairs = zip((x, y), (y, x), self.constants, strict=True)
        return along + [MAPS[self.kind].aside(one, other, c) for one, other, c in pairs]

    def slope(self, axis: int, x: Array) -> Array:
        """Derivative of `shown` (n,)."""
        return self._of("slope", axis, x)

    def inverse(self, axis: int, shown: Array) -> Array:
        """The displacement (n,) [m] along the axis that shows this; of a lens for a motion along the axis."""
        return self._of("inverse", axis, shown)

    def noise(self, axis: int, x: Array) -> Array:
        """Noise of a sample at x (n,) [m], over that at rest."""
        return self._of("noise", axis, x)

    def mean_noise(self, amplitude: float) -> float:
        """Root mean square of `noise` over the vibration, pattern angles evenly."""
        along = amplitude * np.outer(_PHASES, _PHASES)
        axes = range(max(len(self.constants), 1))
        return math.sqrt(max(float(np.mean(self.noise(axis, along) ** 2)) for axis in axes))

    def amplitude_error(self, amplitude: float, relative: float, u_K: float) -> float:
        """Standard uncertainty, relative, of the amplitude [m] read along an axis, the larger of the two: for that of
        the constant, relative, and that of the gauges' temperature, u_K.

        By the describing function (Gelb & Vander Velde 1968, ch. 2): the part in phase of the displacement that an
        error of the map makes, over the amplitude. A layer's is that of |1/(1 + jω0/ωc)|.
        """
        axes = range(len(self.constants))
        return max((self._amplitude_error(axis, amplitude, relative, u_K) for axis in axes), default=0.0)

    def delay_error_s(self, relative: float) -> float:
        """Standard uncertainty [s] of how late a layer's channel is, for that of its corner, relative."""
        if self.kind != "piezoelectric":
            return 0.0
        ratios = [self.omega0 / corner for corner in self.constants]
        return relative * max(r / (1.0 + r * r) for r in ratios) / self.omega0

    def _amplitude_error(self, axis: int, amplitude: float, relative: float, u_K: float) -> float:
        c = self._constant(axis)
        if c == 0.0:
            return 0.0
        if self.kind == "piezoresistive":
            return abs(c) * math.hypot(u_K, relative * u_K)
        x, one, h = amplitude * _PHASES, MAPS[self.kind], 1e-4
        error = (one.shown(x, c * (1.0 + h)) - one.shown(x, c * (1.0 - h))) / (2.0 * h) / one.slope(x, c)
        return relative * abs(2.0 * float(np.mean(error * _PHASES)) / amplitude)

    def _of(self, what: str, axis: int, given: Array) -> Array:
        given = np.asarray(given, float)
        if not self.constants or not self.constants[axis]:
            return np.ones_like(given) if what in ("slope", "noise") else given
        function = getattr(MAPS[self.kind], what)
        return np.asarray(function(given, self._constant(axis)) * np.ones_like(given))

    def _constant(self, axis: int) -> float:
        """As the map takes it."""
        c = self.constants[axis]
        return c / self.omega0 if self.kind == "piezoelectric" else c
