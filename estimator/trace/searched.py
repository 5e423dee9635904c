"""How surely the parameters of an effect were found that no filter estimates."""

from dataclasses import dataclass

import numpy as np

from estimator.scaling import Array


@dataclass(frozen=True)
class Searched:
    """How surely n parameters were found: their covariance (n, n), as where the innovations are what the observer takes
    them to be, and what one unit of each moves each of the k coefficients of the effect by (k, n), SI; at_top: whether
    all of them together came to the top, so that another search would end where this one did.
    """

    names: tuple[str, ...]
    covariance: Array
    moves: Array
    at_top: bool = False

    def deviation(self, name: str) -> float:
        """Standard deviation of a parameter."""
        index = self.names.index(name)
        return float(np.sqrt(self.covariance[index, index]))


NOTHING = Searched((), np.zeros((0, 0)), np.zeros((0, 0)))
"""Of an effect without parameters."""
