"""How many terms of the Taylor series of the linear motion (taylor.h) a step asks for."""

import math
from functools import cache

from estimator.errors import ModelError

_MOST_TERMS = 60
_NORM, _TOLERANCE = 1.5, 1e-14


@cache
def taylor_order(h: float, norm: float = _NORM, tolerance: float = _TOLERANCE) -> int:
    """Order whose remainder (h·norm)^(n+1)/(n+1)! is below `tolerance`.

    A drive of that degree needs as many orders more.  Raises ModelError when the step is so long that no sensible order
    does it (less than two samples a cycle).
    """
    for order in range(2, _MOST_TERMS):
        if (h * norm) ** (order + 1) / math.factorial(order + 1) < tolerance:
            return order
    raise ModelError(
        f"a step of {h:.3g}/ω0 is too long for the flow; sample at least 4 times a cycle, fill gaps with rows of NaN"
    )
