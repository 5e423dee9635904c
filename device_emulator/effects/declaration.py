"""What a hidden effect is: its equation, its coefficients with their units, its own states.

Names, symbols and units are those of the catalogue of tracing (`estimator.effects`) wherever an effect is in both: a
test holds them to it. Equations are the emulator's own.
"""

import math
from typing import NamedTuple

MAX_COEFFICIENTS = 6
MAX_INNER = 12
"""States that all effects of a device may have together, beside the four of the mass."""


class HiddenCoefficient(NamedTuple):
    """One number of an effect: `default` None means that it must be given; `positive`, that it must be above 0;
    `switch`, that it is 0 or 1; `above`, that it must be above that.
    """

    symbol: str
    unit: str
    default: float | None = 0.0
    positive: bool = False
    switch: bool = False
    above: float = -math.inf


class Declaration(NamedTuple):
    """An effect's equation, an addition to the base model; its coefficients in the kernels' order; how many states of
    its own it has.
    """

    equation: str
    coefficients: tuple[HiddenCoefficient, ...]
    states: int = 0


def per_axis(symbol: str, unit: str) -> tuple[HiddenCoefficient, HiddenCoefficient]:
    """`symbol` of x and of y, 0 where not given."""
    return HiddenCoefficient(f"{symbol}x", unit), HiddenCoefficient(f"{symbol}y", unit)


def given(symbol: str, unit: str) -> HiddenCoefficient:
    """One that must be given, above 0."""
    return HiddenCoefficient(symbol, unit, None, positive=True)


def switches() -> tuple[HiddenCoefficient, HiddenCoefficient]:
    """Of each axis whether it is the other way round."""
    return HiddenCoefficient("px", "1", switch=True), HiddenCoefficient("py", "1", switch=True)


def limits(symbol: str, unit: str) -> tuple[HiddenCoefficient, HiddenCoefficient]:
    """A limit of each axis, which must be given."""
    return given(f"{symbol}x", unit), given(f"{symbol}y", unit)


LINE = (
    HiddenCoefficient("frequency", "Hz", None),
    HiddenCoefficient("phase_x", "rad"),
    HiddenCoefficient("phase_y", "rad"),
)
"""Frequency and phases of a sine."""
