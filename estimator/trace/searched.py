"""How surely the parameters of an effect were found that no filter estimates."""

from dataclasses import dataclass

import numpy as np

from estimator.scaling import Array


@dataclass(frozen=True)
class Searched:
    """How surely n parameters were found: their covariance (n, n), as where the innovations are what the observer takes
    them to be, and what one unit of each moves each of the k coefficients of the effect by (k, n), SI.
    """

    names: tuple[str, ...]
    covariance: Array
    moves: Array

    def deviation(self, name: str) -> float:
        """Standard deviation of a parameter."""
        index = self.names.index(name)
        return float(np.sqrt(self.covariance[index, index]))


NOTHING = Searched((), np.zeros((0, 0)), np.zeros((0, 0)))
"""Of an effect without parameters."""
