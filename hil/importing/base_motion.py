"""A base that moves: its displacement, velocity or acceleration as the force that it is on the mass.

Beside its base a mass feels −a of the base as a force per unit mass.  What is not an acceleration is differentiated, by
a spline of degree 7 through the samples.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_DEGREE = 7
FEWEST = _DEGREE + 1
"""Rows that a derivative takes at least."""


class Base:
    """Motion of a base at times t_s (n,), given as its `order`-th derivative by time, SI."""

    def __init__(self, t_s: Floats, values: Floats, order: int) -> None:
        self._t_s, self._values, self._order = t_s, values, order
        self._spline: Any = None

    def derivative(self, order: int) -> Floats:
        """The base's displacement (0), velocity (1) or acceleration (2) at its times.

        Raises ValueError where that would be an integral, whose constant nobody knows.
        """
        if order < self._order:
            raise ValueError("it would be an integral")
        if order == self._order:
            return self._values
        if self._spline is None:
            from scipy.interpolate import make_interp_spline  # where it is asked for: it takes a while to load

            middle = self._t_s - self._t_s[0]
            spline = make_interp_spline(middle, self._values, k=_DEGREE)
            self._spline = (spline, middle)
        spline, middle = self._spline
        return np.asarray(spline.derivative(order - self._order)(middle), dtype=float)

    @property
    def force_mps2(self) -> Floats:
        """Force per unit mass on what rides on it, m/s²."""
        return -self.derivative(2)
