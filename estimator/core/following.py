"""A block of samples observed while effects that are not included are followed (estimator/core/scan.h)."""

import ctypes
from typing import NamedTuple, Protocol

import numpy as np

from estimator.core.arguments import Arguments
from estimator.core.layout import Floats, Ints, Record
from estimator.core.library import LIBRARY
from estimator.core.structures import Arrays

BLOCK = 12
"""The width of a matrix of equations is a multiple of it."""

_SCAN = Arguments("scan.h", "Scan")


class Portion(NamedTuple):
    """n samples: measured z (n, axes), drive u (n, axes, degree + 1) over the interval that ends at each, its length h
    (n,), temperature (n,) or (0,); rows (n,) of OUTPUT receive the estimates.
    """

    z: Floats
    u: Floats
    h: Floats
    temperature: Floats
    rows: Record


class Signatures(NamedTuple):
    """What is followed of k coefficients that the filter does not carry.

    delta (states + active constants, k): sensitivity of the filter's estimates to them, carried on; turned (k,): that
    of the reported angle, of two axes, carried on and written to course (rows, k) at equal distances, the last time
    after the last sample; (0,) where it is not followed.  equations (axes · n, k + 1 or more) receive, where there are
    any, the innovations' sensitivities, behind them the innovation, both whitened, and in a next column, where there is
    one, the logarithm of its deviation.  Samples around an innovation larger than `level` times its variance count
    less, in proportion: a jump of the rate says nothing of an effect.  The first columns are those of the constants
    `known` (indices among all), which the filter does not estimate.
    """

    delta: Floats
    level: float
    equations: Floats
    turned: Floats
    course: Floats
    known: Ints = np.zeros(0, np.int64)


class Observing(Protocol):
    """What is asked of an observer."""

    @property
    def arrays(self) -> Arrays:
        """Its own arrays."""

    @property
    def core(self) -> int:
        """The address of its filter in the core."""


def scan_block(observer: Observing, portion: Portion, signatures: Signatures) -> None:
    """Observe n samples as `Observer.run` does, and follow what is watched; the observer's last k constants are that.

    Raises ValueError for an array that is not contiguous.
    """
    z, u, h, temperature, rows = portion
    delta, level, equations, turned, course, known = signatures
    rows_of_delta, count = delta.shape
    constants = len(observer.arrays.x)
    LIBRARY.gyro_scan_block(
        ctypes.c_void_p(observer.core),
        _SCAN(
            n=len(z), terms=u.shape[2], warm=len(temperature) > 0, count=count, known=len(known),
            weighed=len(equations) > 0, turning=len(turned) > 0, width=equations.shape[1], instants=len(course),
            constants=known, z=z, u=u, h=h, temperature=temperature, rows=rows,
            delta=delta, equations=equations, turned=turned, course=course,
            scratch=np.zeros(2 * constants + (2 + rows_of_delta) * count), level=level,
        ),
    )  # fmt: skip
