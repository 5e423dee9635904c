"""How far the reported angle moves with each coefficient of the catalogue."""

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

    def with_shift(self, name: str, values: Array, covariance: Array) -> "Turning":
        """The same with an effect of these coefficients found there."""
        moves = self.of(name)
        spread = np.einsum("mi,ij,mj->m", moves, covariance, moves)
        return replace(
            self,
            shift=self.shift + moves @ values,
            deviation=np.sqrt(self.deviation**2 + np.maximum(spread, 0.0)),
        )
