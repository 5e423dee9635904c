"""A block of samples observed while effects that are not included are followed (estimator/core/scan.h)."""

import ctypes
from typing import Any, NamedTuple, Protocol

import numpy as np

from estimator.core.arguments import Arguments
from estimator.core.layout import Floats, Ints
from estimator.core.library import LIBRARY
from estimator.core.structures import Arrays

BLOCK = 12
"""The width of a matrix of equations is a multiple of it."""

_SCAN = Arguments("scan.h", "Scan")


class Portion(NamedTuple):
    """n samples: measured z (n, axes), drive u (n, axes, degree + 1) over the interval that ends at each, its length h
    (n,), temperature (n,) or (0,).
    """

    z: Floats
    u: Floats
    h: Floats
    temperature: Floats


class Signatures(NamedTuple):
    """What is followed of k coefficients that the filter does not carry.

    delta (states + active constants, k): sensitivity of the filter's estimates to them, carried on; turned (k,): that
    of the pattern angle of two axes, carried on where it is given.  equations (axes · n, k + 1 or more) receive, where
    they are given, the innovations' sensitivities, behind them the innovation, both whitened, and in a next column,
    where there is one, the logarithm of its deviation.  The first columns are those of the constants `known` (indices
    among all), which the filter does not estimate.
    """

    delta: Floats
    equations: Floats | None = None
    turned: Floats | None = None
    known: Ints = np.zeros(0, np.int64)


class Observing(Protocol):
    """What is asked of an observer."""

    @property
    def arrays(self) -> Arrays:
        """Its own arrays."""

    @property
    def core(self) -> int:
        """The address of its filter in the core."""


def scan_of(observer: Observing, portion: Portion, signatures: Signatures, width: int) -> Any:
    """The core's structure of a scan, rows of its equations so wide. Raises ValueError for an array that is not
    contiguous.
    """
    count = signatures.delta.shape[1]
    given = {**portion._asdict(), **signatures._asdict()}
    constants = given.pop("known")
    return _SCAN(
        n=len(portion.z), terms=portion.u.shape[2], count=count, known=len(constants), width=width, constants=constants,
        scratch=np.zeros(2 * len(observer.arrays.x) + 6 * count),
        **{name: array for name, array in given.items() if array is not None and (name != "temperature" or len(array))},
    )  # fmt: skip


def scan_block(observer: Observing, portion: Portion, signatures: Signatures) -> None:
    """Observe n samples as `Observer.run` does, and follow what is watched; the observer's last k constants are that.

    Raises ValueError for an array that is not contiguous.
    """
    width = 0 if signatures.equations is None else signatures.equations.shape[1]
    LIBRARY.gyro_scan_block(ctypes.c_void_p(observer.core), scan_of(observer, portion, signatures, width))
