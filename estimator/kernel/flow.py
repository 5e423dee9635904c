"""The flow over one step, with its sensitivities: exact for the linear part as a Taylor series, effects as impulses in
it.

Order and step are chosen so that the remainder is below rounding (`taylor_order`): one Runge–Kutta step at 20 samples a
cycle biases the stiffness by 1.3e-4 (PHYSICS.md §3).
"""

import math

import numpy as np

from estimator.errors import ModelError
from estimator.kernel.compiled import compiled, generated
from estimator.kernel.layout import Floats, Record

_field_columns = generated().field_columns
_effect_force = generated().effect_force
_MAX_ORDER = 60
Push = tuple[Floats, Floats, Floats, Floats]  # force, its derivatives by states and by constants, drive
_DRIFTS = (
    0.07534696026989288842,
    0.51791685468825678230,
    -0.09326381495814967072,
    -0.09326381495814967072,
    0.51791685468825678230,
    0.07534696026989288842,
)
_KICKS = (
    0.19022593937367661925,
    0.84652407044352625706,
    -1.07350001963440575260,
    0.84652407044352625706,
    0.19022593937367661925,
)


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
def taylor(
    model: int, c: Floats, u: Floats, h: float, order: int, columns: int, a: Floats, b: Floats, out: Floats
) -> None:
    """Advance the columns of out in place by h under the input polynomial u (axes, degree + 1) in normalised time
    t/h.
    """
    states = out.shape[0]
    for i in range(states):
        for j in range(columns):
            a[i, j] = out[i, j]
    degree = u.shape[1] - 1
    zero = u[:, 0] * 0.0
    for n in range(order):
        _field_columns(model, c, a, u[:, n] if n <= degree else zero, b, columns)
        scale = h / (n + 1)
        for i in range(states):
            for j in range(columns):
                a[i, j] = b[i, j] * scale
                out[i, j] += a[i, j]


@compiled
def effect_forces(
    settings: Record, c: Floats, s: Floats, u: Floats, force: Floats, by_states: Floats, by_constants: Floats
) -> None:
    """Sum of the effects' forces (axes,) at state s and drive u, and its derivatives (axes, states), (axes,
    constants).
    """
    force[:] = 0.0
    by_states[:] = 0.0
    by_constants[:] = 0.0
    for e in range(settings.effect_count):
        _effect_force(
            settings.effects[e, 0], settings.model, c, s, u, settings.effects[e, 1], force, by_states, by_constants
        )


@compiled
def push_columns(
    settings: Record, c: Floats, weight: float, columns: int, at: Floats, start: Floats, out: Floats, push: Push
) -> None:
    """out ← start with the velocities pushed by weight × the effects' forces at the columns `at`, sensitivities
    alike.
    """
    force, by_states, by_constants, drive = push
    states = out.shape[0]
    effect_forces(settings, c, at[:, 0], drive, force, by_states, by_constants)
    for axis in range(settings.axes):
        row = 2 * axis + 1
        out[row, 0] = start[row, 0] + weight * force[axis]
        for j in range(1, columns):
            total = 0.0
            for i in range(states):
                total += by_states[axis, i] * at[i, j]
            column = j - 1 - states
            if column >= 0:
                total += by_constants[axis, settings.sense_constants + column]
            out[row, j] = start[row, j] + weight * total


@compiled
def kick(
    settings: Record,
    c: Floats,
    u: Floats,
    at: float,
    weight: float,
    columns: int,
    a: Floats,
    b: Floats,
    out: Floats,
    push: Push,
) -> None:
    """Give the velocities in the columns of out the impulse weight × the effects' forces, u taken at normalised time
    `at`.

    A force that depends on the velocity changes during the impulse: it is taken from its middle.
    """
    drive = push[3]
    for axis in range(u.shape[0]):
        drive[axis] = 0.0
        power = 1.0
        for n in range(u.shape[1]):
            drive[axis] += u[axis, n] * power
            power *= at
    for i in range(out.shape[0]):
        for j in range(columns):
            a[i, j] = out[i, j]
            b[i, j] = out[i, j]
    push_columns(settings, c, 0.5 * weight, columns, a, a, b, push)
    push_columns(settings, c, weight, columns, b, a, out, push)


@compiled
def part_of(u: Floats, start: float, length: float) -> Floats:
    """The polynomial u over [start, start + length] of its normalised time, in the normalised time of that part."""
    axes, terms = u.shape
    out = np.zeros((axes, terms))
    for axis in range(axes):
        for n in range(terms):
            binomial = 1.0
            for k in range(n, terms):
                out[axis, n] += u[axis, k] * binomial * start ** (k - n) * length**n
                binomial *= (k + 1.0) / (k + 1.0 - n)
    return out


@compiled
def flow(
    settings: Record,
    c: Floats,
    s: Floats,
    u: Floats,
    h: float,
    columns: int,
    a: Floats,
    b: Floats,
    out: Floats,
    push: Push,
) -> None:
    """Advance s by h under the input polynomial u (axes, degree + 1) in normalised time t/h.

    out[:, 0] is the new state; with columns > 1 also ∂/∂s and ∂/∂(flow and effect constants).  a, b are scratch of
    out's shape.  The linear part is exact; effects, which are small, enter as impulses between exact drifts, the
    symmetric scheme of orders (8, 4) of Blanes, Casas, Farrés, Laskar, Makazaga & Murua (Appl. Numer. Math. 68, 2013):
    an error of ε h⁸ + ε² h⁴ for an effect of relative size ε.
    """
    states = s.shape[0]
    for i in range(states):
        for j in range(columns):
            out[i, j] = 0.0
        out[i, 0] = s[i]
        if columns > 1:
            out[i, 1 + i] = 1.0
    order = settings.order
    if settings.effect_count == 0:
        taylor(settings.model, c, u, h, order, columns, a, b, out)
        return
    at = 0.0
    for stage in range(len(_DRIFTS)):
        length = _DRIFTS[stage]
        taylor(settings.model, c, part_of(u, at, length), length * h, order, columns, a, b, out)
        at += length
        if stage < len(_KICKS):
            kick(settings, c, u, at, _KICKS[stage] * h, columns, a, b, out, push)
