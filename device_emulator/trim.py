"""Trim electrodes, from `[[trim]]`: slow outputs of the board that soften the springs by the square of their voltage.

    K(t) = K - Σ C_i V_i(t)²,    V_i' = (code_i scale - V_i) / settling

An electrode across a gap has the energy -½ C V², whose second derivative by the displacement is a negative spring
(comb and parallel plate alike); one that is skew to the axes softens kxy too, of either sign.
"""

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from device_emulator.section import NonNegative, Pair, Section, as_tuple

MAX_TRIMS = 8

TRIM = np.dtype(
    [
        ("count", "i8"),
        ("softening", "f8", (MAX_TRIMS, 3)),  # xx, yy, xy per unit mass and V²
        ("settling_s", "f8", MAX_TRIMS),
    ],
    align=True,
)


class Trim(Section):
    """`[[trim]]`: one electrode and its output, numbered as they stand in the file."""

    name: Annotated[str, Field(min_length=1, max_length=24)]
    """what the board calls it"""
    range_V: Pair
    """[lowest, highest]; 0 lies between"""
    dac_bits: Annotated[int, Field(ge=2, le=24)] = 16
    """of the output, over the whole range"""
    settling_s: NonNegative
    """time constant with which the electrode follows, as the board tells it"""
    softening_N_per_m_per_V2: Annotated[tuple[float, float, float], BeforeValidator(as_tuple)]
    """[xx, yy, xy] that V² takes off the stiffness; zeros: an electrode that is not connected"""

    @model_validator(mode="after")
    def _about_zero(self) -> "Trim":
        lowest, highest = self.range_V
        if not lowest <= 0.0 <= highest or lowest == highest:
            raise ValueError(f"range_V: expected [lowest, highest] around 0, not [{lowest:g}, {highest:g}]")
        return self

    @property
    def scale_V(self) -> float:
        """Volts per code."""
        return (self.range_V[1] - self.range_V[0]) / ((1 << self.dac_bits) - 1)

    @property
    def codes(self) -> tuple[int, int]:
        """Lowest and highest code."""
        return int(self.range_V[0] / self.scale_V), int(self.range_V[1] / self.scale_V)


def trim_constants(trims: Sequence[Trim], mass_kg: float) -> NDArray[Any]:
    """The electrodes as their kernel reads them, shape (1,) of dtype `TRIM`."""
    constants = np.zeros(1, TRIM)
    constants["count"] = len(trims)
    for k, trim in enumerate(trims):
        constants["softening"][0, k] = np.array(trim.softening_N_per_m_per_V2) / mass_kg
        constants["settling_s"][0, k] = trim.settling_s
    return constants
