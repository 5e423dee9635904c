"""The exact flow of the linear part over one step, with its sensitivities, as a Taylor series.

Order and step are chosen so that the remainder is below rounding (`taylor_order`): one Runge–Kutta step at 20 samples a
cycle biases the stiffness by 1.3e-4 (PHYSICS.md §3).
"""

import math

from estimator.errors import ModelError
from estimator.kernel.compiled import compiled, generated
from estimator.kernel.layout import Floats

_field_columns = generated().field_columns
_MAX_ORDER = 60


def taylor_order(h: float, norm: float = 1.5, tolerance: float = 1e-14) -> int:
    """Order whose remainder (h·norm)^(n+1)/(n+1)! is below `tolerance`.

    A drive of that degree needs as many orders more.  Raises ModelError when the step is so long that no sensible order
    does it (less than two samples a cycle).
    """
    for order in range(2, _MAX_ORDER):
        if (h * norm) ** (order + 1) / math.factorial(order + 1) < tolerance:
            return order
    raise ModelError(
        f"a step of {h:.3g}/ω0 is too long for the flow; sample at least 4 times a cycle, fill gaps with rows of NaN"
    )


@compiled
def flow(
    model: int, c: Floats, s: Floats, u: Floats, h: float, order: int, columns: int, a: Floats, b: Floats, out: Floats
) -> None:
    """Advance s by h under the input polynomial u (axes, degree + 1) in normalised time t/h.

    out[:, 0] is the new state; with columns > 1 also ∂/∂s and ∂/∂flow constants.  a, b are scratch of out's shape.
    """
    states = s.shape[0]
    for i in range(states):
        for j in range(columns):
            a[i, j] = 0.0
        a[i, 0] = s[i]
        if columns > 1:
            a[i, 1 + i] = 1.0
        for j in range(columns):
            out[i, j] = a[i, j]
    degree = u.shape[1] - 1
    zero = u[:, 0] * 0.0
    for n in range(order):
        _field_columns(model, c, a, u[:, n] if n <= degree else zero, b, columns)
        scale = h / (n + 1)
        for i in range(states):
            for j in range(columns):
                a[i, j] = b[i, j] * scale
                out[i, j] += a[i, j]
