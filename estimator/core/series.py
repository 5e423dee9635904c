"""Series that remember where another one was, each in one pass of the core (estimator/core/series.h)."""

import numpy as np
from numpy.typing import NDArray

from estimator.core.arguments import Arguments
from estimator.core.library import LIBRARY

Array = NDArray[np.float64]

_SERIES = Arguments("series.h", "Series")


def play(rate: Array, width: float) -> Array:
    """The play operator: follows the rate (n,) at a distance of at most `width` (backlash)."""
    out = np.zeros(len(rate))
    LIBRARY.gyro_play(_SERIES(n=len(rate), given=np.ascontiguousarray(rate, dtype=float), out=out, size=width))
    return out
