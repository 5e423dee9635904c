"""Taylor series of the linear motion: exact for it, to an order whose remainder is below rounding."""

import math
from functools import cache

import numpy as np

from estimator.errors import ModelError
from estimator.kernel.compiled import generated, inlined
from estimator.kernel.layout import Floats

_taylor = generated().taylor
MOST_TERMS = 60
_NORM, _TOLERANCE = 1.5, 1e-14
LONGEST, LONGEST_WITHIN = (
    np.array([(tolerance * math.factorial(n + 1)) ** (1.0 / (n + 1)) / _NORM for n in range(MOST_TERMS)])
    for tolerance in (_TOLERANCE, 1e-11)
)
"""By order, the interval that it does for (`taylor_order`); and where a rule of Gauss, less exact, is to be kept."""


@cache
def taylor_order(h: float, norm: float = _NORM, tolerance: float = _TOLERANCE) -> int:
    """Order whose remainder (h·norm)^(n+1)/(n+1)! is below `tolerance`.

    A drive of that degree needs as many orders more.  Raises ModelError when the step is so long that no sensible order
    does it (less than two samples a cycle).
    """
    for order in range(2, MOST_TERMS):
        if (h * norm) ** (order + 1) / math.factorial(order + 1) < tolerance:
            return order
    raise ModelError(
        f"a step of {h:.3g}/ω0 is too long for the flow; sample at least 4 times a cycle, fill gaps with rows of NaN"
    )


@inlined
def taylor_terms(longest: Floats, t: float, most: int) -> int:
    """The order that an interval of that length asks for, by the longest for each, at most so much."""
    order = 2
    while order < most and abs(t) >= longest[order]:
        order += 1
    return order


@inlined
def taylor(model: int, c: Floats, u: Floats, h: float, order: int, columns: int, term: Floats, out: Floats) -> None:
    """Advance the columns of out in place by h under the input polynomial u (axes, degree + 1) in normalised time
    t/h.

    columns is 1 or all of the model's and more; term is scratch of out's shape.  order is what the longest interval
    asks for: over a shorter one the terms beyond its own are rounding.
    """
    degree = u.shape[1] - 1
    _taylor(model, c, u, h, taylor_terms(LONGEST, h, order - degree) + degree, columns, term, out)
