"""Forward and backward over a record with a gain that has settled, in the core (estimator/core/missing_force.h)."""

from typing import Any

import numpy as np

from estimator.core.arguments import Arguments
from estimator.core.library import LIBRARY
from estimator.scaling import Array

_SETTLED = Arguments(
    ("n", "m", "s", "axes"),
    (
        "transition", "by_rate", "turning", "added", "sense", "seen", "gain", "start", "weight", "covariance",
        "states", "innovation", "scratch",
    ),
)  # fmt: skip


class Settled:
    """A filter whose gain has settled, on its way over some samples.

    Given are transition (m, m); by_rate (s, s) its derivative by the rate, of the motion; turning (n,) the rate about
    which it is not expanded; added (n, s): what is known to push over the interval that ends at each sample; sense
    (n, axes); seen (axes, m); gain (m, axes); start (m,): the prediction of the first sample; weight (axes, axes), the
    inverse of the innovation's covariance; covariance (m, m) of the prediction.
    """

    def __init__(self, **given: Array) -> None:
        n, axes = given["sense"].shape
        m = len(given["start"])
        self.states, self.innovation = np.zeros((n, m)), np.zeros((n, axes))
        self._call: Any = _SETTLED(
            n=n, m=m, s=len(given["by_rate"]), axes=axes,
            **{name: np.ascontiguousarray(array) for name, array in given.items()},
            states=self.states, innovation=self.innovation, scratch=np.zeros(2 * m),
        )  # fmt: skip

    def forward(self) -> None:
        """states (n, m) ← the predicted ones, innovation (n, axes), 0 where a sample is lost."""
        LIBRARY.gyro_settled_forward(self._call)

    def backward(self) -> None:
        """Turn predicted states into smoothed ones, in place (Bryson and Frazier)."""
        LIBRARY.gyro_settled_backward(self._call)
