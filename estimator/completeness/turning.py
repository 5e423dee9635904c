"""How far the reported angle moves with each coefficient of the catalogue."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.scaling import Array


@dataclass(frozen=True)
class Turning:
    """Sensitivity (m, k) of the angle, rad per SI unit, at `time` (m,) s; columns: those of each effect.

    shift, deviation (m,) rad: how far effects that were found there, and are not carried, turned the angle.
    """

    columns: dict[str, slice]
    time: Array
    sensitivity: Array
    shift: Array
    deviation: Array

    def of(self, name: str) -> Array:
        """Columns of an effect (m, its coefficients)."""
        return self.sensitivity[:, self.columns[name]]

    def course(self, names: Sequence[str], values: Array, covariance: Array) -> tuple[Array, Array]:
        """How far (m,) these effects turn the angle, and its standard deviation, with their coefficients (k,) together
        and the covariance (k, k) of those, SI.
        """
        moves = np.hstack([self.of(name) for name in names])
        spread = np.einsum("mi,ij,mj->m", moves, covariance, moves)
        return moves @ values, np.sqrt(np.maximum(spread, 0.0))

    def with_shift(self, shift: Array, deviation: Array) -> "Turning":
        """The same with something found there that turned the angle by so much (m,), rad."""
        return replace(self, shift=self.shift + shift, deviation=np.hypot(self.deviation, deviation))
