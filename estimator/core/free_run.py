"""A record run freely by the core, with what every unknown does to it (estimator/core/simulation.h)."""

import ctypes

import numpy as np

from estimator.core.arguments import Arguments
from estimator.core.following import Observing
from estimator.core.layout import Floats
from estimator.core.library import LIBRARY

_RUN = Arguments("simulation.h", "FreeRun")


def free_run(
    observer: Observing, x: Floats, u: Floats, h: Floats, *, order: int, parts: int, sensitive: bool, time: float = 0.0
) -> tuple[Floats, Floats]:
    """Run from x = [state at the first sample, constants] under u (n, axes, degree + 1) over the steps h (n,), scaled.

    Each step is taken in `parts` equal parts, by a Taylor flow of that order; time: of the first sample, which lines
    count from.  What is sensed (n, axes), and with `sensitive` its derivative by x (n, axes, states + constants), else
    0 rows of it.
    """
    n, axes, terms = u.shape
    sensed, sensitivity = np.zeros((n, axes)), np.zeros((n if sensitive else 0, axes, len(x)))
    run = _RUN(
        n=n, terms=terms, parts=parts, sensitive=sensitive, order=order, total=len(x), x=x, u=u, h=h, sensed=sensed,
        sensitivity=sensitivity, full=np.zeros((2, len(x))), time=time,
    )  # fmt: skip
    LIBRARY.gyro_free_run(ctypes.c_void_p(observer.core), run)
    return sensed, sensitivity
