"""The observer of 13 states without effects, its covariances in vector registers: what streams.

The same filter as `estimator.kernel.observer`, which does everything else: flow with sensitivities, fading memory, the
covariance P that the gain comes from and the covariance C that the estimates have under it, stabilised forgetting.
What is particular to it: F is [Fs Fc; 0 I] with four rows that are not the identity's, and each measurement, of one
axis or of a constant against its guess, is taken in on its own, which for uncorrelated noise is the same as both at
once.

A covariance is a flat array of 13 rows of 16 numbers: row and column 0–3 the states, 4–12 the constants, then zeros.
It is symmetric, and what stands left of the diagonal block of the constants is neither kept nor read.
"""

import math

import numpy as np

from estimator.kernel.angle import note_forced_rotation, read_angle
from estimator.kernel.angle_error import note_gradient, refer_angle
from estimator.kernel.compiled import compiled, generated, inlined
from estimator.kernel.lanes import gather, lane, put, put_columns, take
from estimator.kernel.layout import RATE, Floats, Ints, Record
from estimator.kernel.observer import ATTENTION, fading_factor

_flow_lanes = generated().gyro_flow_lanes
_jump = generated().gyro_jump

STATES = 4
CONSTANTS = 9
SIZE = STATES + CONSTANTS
_W = 16  # width of a row
_FLOW = 12  # columns of the flow: state, ∂/∂s, ∂/∂(the seven constants behind the sense offsets)
# Places in the workspace.
_COLUMNS = STATES * _FLOW
_T = 2 * _COLUMNS  # the states' rows of the covariance to be
_MIRROR = _T + STATES * _W
_NOISE = _MIRROR + 4 * STATES
_Y = _NOISE + 4 * STATES
_V = _Y + _W
_B = _V + _W
_KICK = _B + _W
_UNIT = _KICK + 4
_ANGLE = _UNIT + CONSTANTS * 12  # covariance of the angle with states and constants
_ANGLE_VARIANCE = _ANGLE + _W
_GRADIENT = _ANGLE_VARIANCE + 4  # of the pattern angle
_END = _GRADIENT + 4


@compiled
def is_plain(settings: Record, active: Ints, x: Floats) -> bool:
    """Whether these kernels do what the settings ask for."""
    fading: bool = settings.twin == 1 and settings.stationary == 0
    bare: bool = settings.effect_count == 0 and settings.signal_count == 0 and x.shape[0] == SIZE
    two_axes: bool = settings.axes == 2 and active.shape[0] == CONSTANTS
    return fading and bare and two_axes


@compiled
def plain_state(x: Floats, p: Floats, c: Floats, memory: Record, wanted: bool) -> tuple[Floats, Floats, Floats, Floats]:
    """State vector (16,), covariances (13 · 16,) each and scratch of the functions below; empty unless wanted."""
    if not wanted:
        nothing = np.zeros(0)
        return nothing, nothing, nothing, nothing
    flat_x, flat_p, flat_c = np.zeros(_W), np.zeros(SIZE * _W), np.zeros(SIZE * _W)
    for i in range(SIZE):
        flat_x[i] = x[i]
        for j in range(SIZE):
            flat_p[_W * i + j] = p[i, j]
            flat_c[_W * i + j] = c[i, j]
    work = np.zeros(_END)
    for k in range(CONSTANTS):
        work[_UNIT + 13 * k] = 1.0
    for i in range(SIZE):
        work[_ANGLE + i] = memory.angle_cross[i]
    work[_ANGLE_VARIANCE] = memory.angle_variance
    return flat_x, flat_p, flat_c, work


@compiled
def restore(
    flat_x: Floats, flat_p: Floats, flat_c: Floats, work: Floats, x: Floats, p: Floats, c: Floats, memory: Record
) -> None:
    """State vector (13,), covariances (13, 13) and those of the angle out of the flat ones and the scratch."""
    memory.angle_variance = work[_ANGLE_VARIANCE]
    for i in range(SIZE):
        memory.angle_cross[i] = work[_ANGLE + i]
    for i in range(SIZE):
        x[i] = flat_x[i]
        for j in range(i, SIZE):
            p[i, j] = flat_p[_W * i + j]
            p[j, i] = flat_p[_W * i + j]
            c[i, j] = flat_c[_W * i + j]
            c[j, i] = flat_c[_W * i + j]


@compiled
def propagate_plain(p: Floats, work: Floats, factor: float) -> None:
    """p ← factor · F p Fᵀ plus the states' noise in work, by the flow in work.

    With T = [Fs Fc] p the constants' part of the states' rows is T's own, and their square part D + Dᵀ with
    D = [½ Fs Pss, Fs Psc + ½ Fc Pcc] [Fs Fc]ᵀ, which needs nothing from below the diagonal.
    """
    for i in range(STATES):
        f = _FLOW * i
        a = (
            work[f + 1] * take(p, 4, 12)
            + work[f + 2] * take(p, _W + 4, 12)
            + work[f + 3] * take(p, 2 * _W + 4, 12)
            + work[f + 4] * take(p, 3 * _W + 4, 12)
        )
        b = (  # the sense offsets, rows 4 and 5, move nothing
            work[f + 5] * take(p, 6 * _W + 4, 12)
            + work[f + 6] * take(p, 7 * _W + 4, 12)
            + work[f + 7] * take(p, 8 * _W + 4, 12)
            + work[f + 8] * take(p, 9 * _W + 4, 12)
            + work[f + 9] * take(p, 10 * _W + 4, 12)
            + work[f + 10] * take(p, 11 * _W + 4, 12)
            + work[f + 11] * take(p, 12 * _W + 4, 12)
        )
        left = 0.5 * (
            work[f + 1] * take(p, 0, 4)
            + work[f + 2] * take(p, _W, 4)
            + work[f + 3] * take(p, 2 * _W, 4)
            + work[f + 4] * take(p, 3 * _W, 4)
        )
        right = a + 0.5 * b
        d = (
            lane(left, 0) * take(work, _COLUMNS + 4, 4)
            + lane(left, 1) * take(work, _COLUMNS + 8, 4)
            + lane(left, 2) * take(work, _COLUMNS + 12, 4)
            + lane(left, 3) * take(work, _COLUMNS + 16, 4)
            + lane(right, 2) * take(work, _COLUMNS + 20, 4)
            + lane(right, 3) * take(work, _COLUMNS + 24, 4)
            + lane(right, 4) * take(work, _COLUMNS + 28, 4)
            + lane(right, 5) * take(work, _COLUMNS + 32, 4)
            + lane(right, 6) * take(work, _COLUMNS + 36, 4)
            + lane(right, 7) * take(work, _COLUMNS + 40, 4)
            + lane(right, 8) * take(work, _COLUMNS + 44, 4)
        )
        put(work, _T + _W * i, d)
        put(work, _T + _W * i + 4, a + b)
    put_columns(
        work, _MIRROR, take(work, _T, 4), take(work, _T + _W, 4), take(work, _T + 2 * _W, 4), take(work, _T + 3 * _W, 4)
    )
    for i in range(STATES):
        square = take(work, _T + _W * i, 4) + take(work, _MIRROR + 4 * i, 4)
        put(p, _W * i, factor * square + take(work, _NOISE + 4 * i, 4))
        put(p, _W * i + 4, factor * take(work, _T + _W * i + 4, 12))
    if factor != 1.0:
        for i in range(STATES, SIZE):
            put(p, _W * i + 4, factor * take(p, _W * i + 4, 12))


@inlined
def force_noise(settings: Record, h: float, work: Floats) -> None:
    """Covariance of what force noise does to the states over h, into work."""
    for axis in range(2):
        q = settings.force_noise[axis]
        at = _NOISE + 10 * axis
        work[at] = q * h * h * h / 3.0
        work[at + 1] = q * h * h / 2.0
        work[at + 4] = q * h * h / 2.0
        work[at + 5] = q * h


@compiled
def walk_constant(p: Floats, work: Floats, k: int, q: float) -> None:
    """Random walk of constant k, variance q; what its steps do to the states stands in work."""
    p[(_W + 1) * (STATES + k)] += q
    kick = take(work, _KICK, 4)
    unit = take(work, _UNIT + 12 * k, 12)
    for i in range(STATES):
        w = q * work[_KICK + i]
        if w != 0.0:
            put(p, _W * i, take(p, _W * i, 4) + w * kick)
            put(p, _W * i + 4, take(p, _W * i + 4, 12) + w * unit)


@inlined
def predict_angle_plain(c: Floats, h: float, work: Floats) -> None:
    """`estimator.kernel.angle_error.predict_angle` and `move_angle`, by the flow in work."""
    rate = STATES + RATE
    work[_ANGLE_VARIANCE] += h * (2.0 * work[_ANGLE + rate] + h * c[(_W + 1) * rate])
    along = gather((c[rate], c[_W + rate], c[2 * _W + rate], c[3 * _W + rate]))
    s = take(work, _ANGLE, 4) + h * along
    k = take(work, _ANGLE + 4, 12) + h * take(c, _W * rate + 4, 12)
    put(work, _ANGLE + 4, k)
    put(
        work,
        _ANGLE,
        lane(s, 0) * take(work, _COLUMNS + 4, 4)
        + lane(s, 1) * take(work, _COLUMNS + 8, 4)
        + lane(s, 2) * take(work, _COLUMNS + 12, 4)
        + lane(s, 3) * take(work, _COLUMNS + 16, 4)
        + lane(k, 2) * take(work, _COLUMNS + 20, 4)
        + lane(k, 3) * take(work, _COLUMNS + 24, 4)
        + lane(k, 4) * take(work, _COLUMNS + 28, 4)
        + lane(k, 5) * take(work, _COLUMNS + 32, 4)
        + lane(k, 6) * take(work, _COLUMNS + 36, 4)
        + lane(k, 7) * take(work, _COLUMNS + 40, 4)
        + lane(k, 8) * take(work, _COLUMNS + 44, 4),
    )


@inlined
def predict_plain(
    settings: Record,
    memory: Record,
    walk: Floats,
    x: Floats,
    p: Floats,
    c: Floats,
    u: Floats,
    h: float,
    work: Floats,
) -> None:
    """Advance state and covariances over h with the drive u (2, degree + 1) that acted."""
    _flow_lanes(x[STATES:], x, u, h, settings.order, work)
    put(x, 0, take(work, _COLUMNS, 4))
    force_noise(settings, h, work)
    predict_angle_plain(c, h, work)
    propagate_plain(c, work, 1.0)
    propagate_plain(p, work, fading_factor(settings, memory))
    kick = work[_KICK:_UNIT]
    for k in range(CONSTANTS):
        if walk[k] != 0.0:
            _jump(x, k, kick)
            walk_constant(c, work, k, walk[k] * h)
            walk_constant(p, work, k, walk[k] * h)


@inlined
def exchange(p: Floats, plus: int, minus: int, work: Floats) -> None:
    """p ← p + b bᵀ − v vᵀ, vectors in work."""
    bs = take(work, plus, 4)
    bc = take(work, plus + 4, 12)
    vs = take(work, minus, 4)
    vc = take(work, minus + 4, 12)
    for i in range(STATES):
        put(p, _W * i, take(p, _W * i, 4) - work[minus + i] * vs + work[plus + i] * bs)
    for i in range(SIZE):
        put(p, _W * i + 4, take(p, _W * i + 4, 12) - work[minus + i] * vc + work[plus + i] * bc)


@inlined
def remove(p: Floats, minus: int, work: Floats) -> None:
    """p ← p − v vᵀ, the vector in work."""
    vs = take(work, minus, 4)
    vc = take(work, minus + 4, 12)
    for i in range(STATES):
        put(p, _W * i, take(p, _W * i, 4) - work[minus + i] * vs)
    for i in range(SIZE):
        put(p, _W * i + 4, take(p, _W * i + 4, 12) - work[minus + i] * vc)


@compiled
def measure(axis: int, k: int, innovation: float, noise: float, x: Floats, p: Floats, c: Floats, work: Floats) -> float:
    """Take in a measurement of constant k plus, with axis ≥ 0, that axis's position; returns ν²/S, expected 1.

    With S = hᵀPh + R and y = Ph/√S the gain is y/√S and P ← P − y yᵀ.  With v = Ch/√Sc, Sc = hᵀCh + R, Joseph's form
    (I − KH) C (I − KH)ᵀ + K R Kᵀ is C − v vᵀ + (√Sc K − v)(√Sc K − v)ᵀ.
    """
    row = _W * (STATES + k)
    column = STATES + k
    ps = gather((p[column], p[_W + column], p[2 * _W + column], p[3 * _W + column]))
    cs = gather((c[column], c[_W + column], c[2 * _W + column], c[3 * _W + column]))
    pc = take(p, row + 4, 12)
    cc = take(c, row + 4, 12)
    sp = p[row + column] + noise
    sc = c[row + column] + noise
    if axis >= 0:
        place = 2 * _W * axis
        sp += 2.0 * p[place + column] + p[place + 2 * axis]
        sc += 2.0 * c[place + column] + c[place + 2 * axis]
        ps = ps + take(p, place, 4)
        cs = cs + take(c, place, 4)
        pc = pc + take(p, place + 4, 12)
        cc = cc + take(c, place + 4, 12)
    root = math.sqrt(sp)
    whitened = innovation / root
    ys = (1.0 / root) * ps
    yc = (1.0 / root) * pc
    put(x, 0, take(x, 0, 4) + whitened * ys)
    put(x, 4, take(x, 4, 12) + whitened * yc)
    put(work, _Y, ys)
    put(work, _Y + 4, yc)
    remove(p, _Y, work)
    actual = math.sqrt(sc)
    vs = (1.0 / actual) * cs
    vc = (1.0 / actual) * cc
    put(work, _V, vs)
    put(work, _V + 4, vc)
    put(work, _B, (actual / root) * ys - vs)
    put(work, _B + 4, (actual / root) * yc - vc)
    # Of the angle: turn its gain, seen its covariance with what is measured (`angle_error.recall_angle`).
    turn = 0.0
    for i in range(4):
        turn -= work[_GRADIENT + i] * work[_Y + i] / root
    seen = work[_ANGLE + column]
    if axis >= 0:
        seen += work[_ANGLE + 2 * axis]
    work[_ANGLE_VARIANCE] += (sc * turn - 2.0 * seen) * turn
    share = (sc * turn - seen) / root
    put(work, _ANGLE, take(work, _ANGLE, 4) + share * ys - turn * cs)
    put(work, _ANGLE + 4, take(work, _ANGLE + 4, 12) + share * yc - turn * cc)
    exchange(c, _B, _V, work)
    return whitened * whitened


@inlined
def correct_plain(
    settings: Record,
    memory: Record,
    prior: Floats,
    spread: Floats,
    guess: Floats,
    x: Floats,
    p: Floats,
    c: Floats,
    z: Floats,
    work: Floats,
    row: Record,
) -> None:
    """Update state and covariances with z (NaN: no measurement); innovation and its variance go to the output row."""
    surprise = 0.0
    measured = False
    for axis in range(2):  # what is predicted before either is taken in
        usable = np.isfinite(z[axis])
        measured = measured or usable
        at = 2 * axis
        k = STATES + axis
        row.nu[axis] = z[axis] - (x[at] + x[k]) if usable else 0.0
        row.s[axis] = settings.noise[axis]
        if usable:
            row.s[axis] += c[(_W + 1) * at] + 2.0 * c[_W * at + k] + c[(_W + 1) * k]
    if not measured:
        return
    for axis in range(2):
        if np.isfinite(z[axis]):
            innovation = z[axis] - (x[2 * axis] + x[STATES + axis])
            surprise += 0.5 * measure(axis, axis, innovation, settings.noise[axis], x, p, c, work)
    memory.surprise += (surprise - memory.surprise) * ATTENTION
    memory.cursor = (memory.cursor + 1) % CONSTANTS
    k = memory.cursor
    if prior[k] > 0.0:  # else known exactly from the start: nothing is forgotten of it
        measure(-1, k, guess[k] - x[STATES + k], prior[k], x, p, c, work)
    for k in range(CONSTANTS):
        variance = p[(_W + 1) * (STATES + k)]
        if spread[k] > 0.0 and variance > spread[k]:
            noise = variance * spread[k] / (variance - spread[k])
            measure(-1, k, guess[k] - x[STATES + k], noise, x, p, c, work)


@inlined
def advance_plain(
    settings: Record,
    memory: Record,
    walk: Floats,
    prior: Floats,
    spread: Floats,
    guess: Floats,
    x: Floats,
    p: Floats,
    c: Floats,
    z: Floats,
    u: Floats,
    h: float,
    work: Floats,
    row: Record,
) -> None:
    """`estimator.kernel.block.advance` with flat covariances and x filled up to 16."""
    predict_plain(settings, memory, walk, x, p, c, u, h, work)
    note_forced_rotation(settings, memory, x, h)
    note_gradient(settings, memory, x)
    for i in range(4):
        work[_GRADIENT + i] = memory.gradient[i]
    correct_plain(settings, memory, prior, spread, guess, x, p, c, z, work, row)
    memory.time += h
    read_angle(settings, memory, x, h, row)
    if refer_angle(settings, memory):
        for i in range(_ANGLE, _ANGLE_VARIANCE + 1):
            work[i] = 0.0
    row.angle_variance = work[_ANGLE_VARIANCE] / settings.angular_gain**2
