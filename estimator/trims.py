"""Trim electrodes as known inputs of an observer: the stiffness follows the voltage that acted.

    K(t) = K0 - Σ C_i V_i(t)²

V_i settles to what was put out with the time constant that the board tells; C_i is declared, with an uncertainty that
the stiffness takes over as the voltage changes (docs/decisions/0008-observer-gains.md).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.core.layout import MAX_TRIMS, TRIMS
from estimator.errors import ModelError

STIFFNESS = ("kxx", "kyy", "kxy")


class Electrode(NamedTuple):
    """softening, softening_u: [xx, yy, xy] that V² takes off the stiffness, 1/s²/V², and its standard uncertainty;
    settling: time constant, s."""

    softening: tuple[float, float, float]
    softening_u: tuple[float, float, float]
    settling: float


class Trims:
    """The electrodes of one observer, all at 0 V at first; `record` is what the core advances from sample to sample."""

    def __init__(self) -> None:
        self.record = np.zeros(1, TRIMS)
        self._omega0 = 1.0

    def declare(self, electrodes: Sequence[Electrode], omega0: float, estimated: Sequence[str]) -> None:
        """Have these, on a gyro of that scale [rad/s] whose constants `estimated` have a row in the covariance.

        Raises ModelError for more than there can be.
        """
        if len(electrodes) > MAX_TRIMS:
            raise ModelError(f"{len(electrodes)} trim electrodes; {MAX_TRIMS} are supported")
        self._omega0 = omega0
        record = self.record[0]
        record["count"] = len(electrodes)
        record["rows"] = [estimated.index(name) if name in estimated else -1 for name in STIFFNESS]
        for k, one in enumerate(electrodes):
            record["softening"][k] = np.array(one.softening) / omega0**2
            record["variance"][k] = (np.array(one.softening_u) / omega0**2) ** 2
            record["settling"][k] = one.settling * omega0

    def put(self, output: int, volts: float, since: float = 0.0) -> None:
        """The board has put another voltage out, so many seconds before the interval that comes next begins."""
        record = self.record[0]
        settling = float(record["settling"][output])
        reached = -math.expm1(-since * self._omega0 / settling) if settling > 0.0 else 1.0
        record["volts"][output] += (volts - record["target"][output]) * reached
        record["target"][output] = volts

    def target_V(self, output: int) -> float:
        """Voltage that was put out to one."""
        return float(self.record["target"][0, output])

    @property
    def volts(self) -> NDArray[np.float64]:
        """Of the electrodes by now, as modelled (count,)."""
        record = self.record[0]
        return np.array(record["volts"][: int(record["count"])])

    @property
    def softened(self) -> NDArray[np.float64]:
        """What they have taken off [kxx, kyy, kxy] by now, 1/s²."""
        record = self.record[0]
        return np.asarray(record["squared"] @ record["softening"] * self._omega0**2)

    @property
    def softened_u(self) -> NDArray[np.float64]:
        """Standard uncertainty of that by those of the coefficients, 1/s²."""
        record = self.record[0]
        return np.asarray(np.sqrt(record["squared"] ** 2 @ record["variance"]) * self._omega0**2)
