"""Series that remember where another one was, each in one pass of the core (estimator/core/series.h)."""

import numpy as np
from numpy.typing import NDArray

from estimator.core.arguments import Arguments
from estimator.core.library import LIBRARY

Array = NDArray[np.float64]

_SERIES = Arguments(("n", "count"), ("given", "shares", "out"), ("size",))
_LEVELS = Arguments(("n",), ("values", "there", "came", "path"), ("low", "high", "variance", "often"))


def slipped(q: Array, reach: float, *, rounded: bool) -> Array:
    """How far a spring that slips is drawn (n,) along q (n,): all at once at its reach (Prandtl), or, rounded, more and
    more towards it and, unloaded, not at all (Bouc and Wen, exponent 1).
    """
    out = np.zeros(len(q))
    LIBRARY.gyro_slip(_SERIES(n=len(q), count=rounded, given=np.ascontiguousarray(q), out=out, size=reach))
    return out


def behind(asked: Array, most: float, shares: Array) -> Array:
    """What a drive (n,) that changes by no more than `most` in an interval is behind the one that is asked, at these
    shares of each interval (n, shares): it ramps towards it from where it was, and stays.
    """
    out = np.zeros((len(asked), len(shares)))
    LIBRARY.gyro_ramp(
        _SERIES(
            n=len(asked), count=len(shares), given=np.ascontiguousarray(asked), shares=np.ascontiguousarray(shares),
            out=out, size=most,
        )
    )  # fmt: skip
    return out


def play(rate: Array, width: float) -> Array:
    """The play operator: follows the rate (n,) at a distance of at most `width` (backlash)."""
    out = np.zeros(len(rate))
    LIBRARY.gyro_play(_SERIES(n=len(rate), given=np.ascontiguousarray(rate, dtype=float), out=out, size=width))
    return out


def likeliest_path(
    values: Array, there: NDArray[np.bool_], levels: tuple[float, float], variance: float, often: float
) -> NDArray[np.int64]:
    """The likeliest path (n,) between two levels, 0 and 1, through values (n,) of that variance where they are there
    (Viterbi); often: the probability of a change from one sample to the next.
    """
    n = len(values)
    path = np.zeros(n, dtype=np.int64)
    low, high = levels
    LIBRARY.gyro_likeliest_path(
        _LEVELS(
            n=n, values=np.ascontiguousarray(values), there=there, came=np.zeros((n, 2), np.int8), path=path, low=low,
            high=high, variance=variance, often=often,
        )
    )  # fmt: skip
    return path
