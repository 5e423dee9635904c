"""The parts of a filter step's source that are the same for every set of effects (`estimator.kernel.generate.step`)."""

FLOW_HEAD = '''_STAGES = 8
LENGTHS = DRIFTS[:4]
LENGTH_OF = (0, 1, 2, 3, 3, 2, 1, 0)
_ROOT = math.sqrt(0.6)
NODES = (0.5 - 0.5 * _ROOT, 0.5, 0.5 + 0.5 * _ROOT, 1.0)
WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
SHARES = tuple(length * node for length in LENGTHS for node in NODES)


@compiled
def orders(h, work):
    """Terms of the series of each of the 16 matrices, into work, found anew where h is another; returns the most."""
    if work[_ORDERS + 16] != h:
        work[_ORDERS + 16] = h
        most = 2
        for m in range(16):
            own = 2
            while own < _MOST and abs(SHARES[m] * h) >= LONGEST[own]:
                own += 1
            work[_ORDERS + m] = own
            most = max(most, own)
        work[_ORDERS + 17] = most
    return int(work[_ORDERS + 17])


@inlined
def exponentials(work):
    """E(τ) and what the drive does up to τ, columns of four, for the points of the rule and the end of each length."""
    for m in range(16):
        share = SHARES[m]
        power = 1.0
        a0, a1, a2 = take(work, _POWERS, 4), take(work, _POWERS + 4, 4), take(work, _POWERS + 8, 4)
        a3, a4 = take(work, _POWERS + 12, 4), take(work, _POWERS + 16, 4)
        for n in range(1, int(work[_ORDERS + m]) + 1):
            power *= share
            at = _POWERS + 20 * n
            a0 = a0 + power * take(work, at, 4)
            a1 = a1 + power * take(work, at + 4, 4)
            a2 = a2 + power * take(work, at + 8, 4)
            a3 = a3 + power * take(work, at + 12, 4)
            a4 = a4 + power * take(work, at + 16, 4)
        to = _DRIFTS_AT + 20 * m
        put(work, to, a0)
        put(work, to + 4, a1)
        put(work, to + 8, a2)
        put(work, to + 12, a3)
        put(work, to + 16, a4)


'''

MODULE = '''"""A filter step, from a model and its effects (estimator.kernel.generate.step); not to be edited."""

import math

import numpy as np

from estimator.kernel.angle import note_forced_rotation, read_angle
from estimator.kernel.angle_error import note_gradient, refer_angle
from estimator.kernel.compiled import compiled, generated, inlined
from estimator.kernel.controller import advance_queue, command, virtual_rate
from estimator.kernel.drifts import DRIFTS, KICKS
from estimator.kernel.taylor import LONGEST
from estimator.kernel.lanes import gather, lane, put, put_columns, take
from estimator.kernel.layout import MAX_SIGNALS, RATE
from estimator.kernel.observer import ATTENTION, fading_factor, workspace
from estimator.kernel.signals import advance_signals, line_values, signal_values
from estimator.kernel.structures import Constants, Estimate, Projected, Sample

_${model}_flow_lanes = generated().${model}_flow_lanes
_jump = generated().${model}_jump

STATES = 4
CONSTANTS = ${constants}
SIZE = STATES + CONSTANTS
_W = ${width}  # width of a row
_FLOW = ${columns}  # columns of the flow: state, by the states, by the flowing constants
_MOST = 20
# Places in the workspace.
_COLUMNS = STATES * _FLOW
_T = 2 * _COLUMNS  # the states' rows of the covariance to be
_MIRROR = _T + STATES * _W
_NOISE = _MIRROR + 4 * STATES
_Y = _NOISE + 4 * STATES
_V = _Y + _W
_B = _V + _W
_JUMP = _B + _W
_UNIT = _JUMP + 4
_ANGLE = _UNIT + CONSTANTS * (_W - STATES)  # covariance of the angle with states and constants
_ANGLE_VARIANCE = _ANGLE + _W
_GRADIENT = _ANGLE_VARIANCE + 4  # of the pattern angle
_H = _GRADIENT + 4  # derivatives of what is measured
_SIGNALS = _H + 2 * SIZE
_POWERS = _SIGNALS + 2 * MAX_SIGNALS  # (M h)^n / n! and what the drive does, columns of four
_DRIFT = 80  # four matrices with four columns and the drive's
_DRIFTS_AT = _POWERS + 20 * (_MOST + 1)
_PASS = 12 + 2 * CONSTANTS  # the states, an impulse's derivatives by them and by the constants
_PASSES = _DRIFTS_AT + 4 * _DRIFT
_ORDERS = _PASSES + 8 * _PASS
_END = _ORDERS + 20


${flow}


@compiled
def unpacked(x, p, c, memory, wanted):
    """State vector, covariances and scratch of the functions below, flat; empty unless wanted."""
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
        work[_UNIT + (_W - STATES + 1) * k] = 1.0
    for i in range(SIZE):
        work[_ANGLE + i] = memory.angle_cross[i]
    work[_ANGLE_VARIANCE] = memory.angle_variance
    return flat_x, flat_p, flat_c, work


@compiled
def restore(flat_x, flat_p, flat_c, work, x, p, c, memory):
    """State vector, covariances and those of the angle out of the flat ones and the scratch."""
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
def propagate(p, work, factor):
    """p <- factor F p F' plus the states' noise in work, by the flow in work.

    With T = [Fs Fc] p the constants' part of the states' rows is T's own, and their square part D + D' with
    D = [Fs Pss / 2, Fs Psc + Fc Pcc / 2] [Fs Fc]', which needs nothing from below the diagonal.
    """
    for i in range(STATES):
${apart}
        put(work, _T + _W * i, d)
        put(work, _T + _W * i + 4, a + b)
    put_columns(
        work, _MIRROR, take(work, _T, 4), take(work, _T + _W, 4), take(work, _T + 2 * _W, 4), take(work, _T + 3 * _W, 4)
    )
    for i in range(STATES):
        square = take(work, _T + _W * i, 4) + take(work, _MIRROR + 4 * i, 4)
        put(p, _W * i, factor * square + take(work, _NOISE + 4 * i, 4))
        put(p, _W * i + 4, factor * take(work, _T + _W * i + 4, ${lanes}))
    if factor != 1.0:
        for i in range(STATES, SIZE):
            put(p, _W * i + 4, factor * take(p, _W * i + 4, ${lanes}))


@inlined
def force_noise(settings, h, work):
    """Covariance of what force noise does to the states over h, into work."""
    for axis in range(2):
        q = settings.force_noise[axis]
        at = _NOISE + 10 * axis
        work[at] = q * h * h * h / 3.0
        work[at + 1] = q * h * h / 2.0
        work[at + 4] = q * h * h / 2.0
        work[at + 5] = q * h


@compiled
def add_random_walk(p, work, k, q):
    """Random walk of constant k, variance q; what its steps do to the states stands in work."""
    p[(_W + 1) * (STATES + k)] += q
    jump = take(work, _JUMP, 4)
    unit = take(work, _UNIT + (_W - STATES) * k, ${lanes})
    for i in range(STATES):
        w = q * work[_JUMP + i]
        if w != 0.0:
            put(p, _W * i, take(p, _W * i, 4) + w * jump)
            put(p, _W * i + 4, take(p, _W * i + 4, ${lanes}) + w * unit)


@inlined
def predict_angle(c, h, work):
    """`estimator.kernel.angle_error.predict_angle` and `move_angle`, by the flow in work."""
    rate = STATES + RATE
    work[_ANGLE_VARIANCE] += h * (2.0 * work[_ANGLE + rate] + h * c[(_W + 1) * rate])
    along = gather((c[rate], c[_W + rate], c[2 * _W + rate], c[3 * _W + rate]))
    s = take(work, _ANGLE, 4) + h * along
    k = take(work, _ANGLE + 4, ${lanes}) + h * take(c, _W * rate + 4, ${lanes})
    put(work, _ANGLE + 4, k)
    put(work, _ANGLE, ${angle})


@inlined
def predict(settings, intensity, estimate, u, h, work):
    """Advance state and covariances over h with the drive u (2, degree + 1) that acted."""
    x, p, c, memory = estimate.x, estimate.p, estimate.c, estimate.memory
${move}
    force_noise(settings, h, work)
    predict_angle(c, h, work)
    propagate(c, work, 1.0)
    propagate(p, work, fading_factor(settings, memory))
    jump = work[_JUMP:_UNIT]
    for k in range(CONSTANTS):
        if intensity[k] != 0.0:
            _jump(x, k, jump)
            add_random_walk(c, work, k, intensity[k] * h)
            add_random_walk(p, work, k, intensity[k] * h)


@inlined
def exchange(p, plus, minus, work):
    """p <- p + b b' - v v', vectors in work."""
    bs = take(work, plus, 4)
    bc = take(work, plus + 4, ${lanes})
    vs = take(work, minus, 4)
    vc = take(work, minus + 4, ${lanes})
    for i in range(STATES):
        put(p, _W * i, take(p, _W * i, 4) - work[minus + i] * vs + work[plus + i] * bs)
    for i in range(SIZE):
        put(p, _W * i + 4, take(p, _W * i + 4, ${lanes}) - work[minus + i] * vc + work[plus + i] * bc)


@inlined
def remove(p, minus, work):
    """p <- p - v v', the vector in work."""
    vs = take(work, minus, 4)
    vc = take(work, minus + 4, ${lanes})
    for i in range(STATES):
        put(p, _W * i, take(p, _W * i, 4) - work[minus + i] * vs)
    for i in range(SIZE):
        put(p, _W * i + 4, take(p, _W * i + 4, ${lanes}) - work[minus + i] * vc)


@inlined
def take_in(innovation, shown, estimate, work):
    """A measurement, of which `shown` says what it shows of both covariances, taken in; returns the innovation over
    sqrt S.

    With S = h'Ph + R and y = Ph / sqrt S the gain is y / sqrt S and P <- P - y y'.  With v = Ch / sqrt Sc, Joseph's
    form (I - KH) C (I - KH)' + K R K' is C - v v' + (sqrt Sc K - v)(sqrt Sc K - v)'.
    """
    x, p, c = estimate.x, estimate.p, estimate.c
    ps, pc, sp, cs, cc, sc, seen = shown
    root = math.sqrt(sp)
    whitened = innovation / root
    ys = (1.0 / root) * ps
    yc = (1.0 / root) * pc
    put(x, 0, take(x, 0, 4) + whitened * ys)
    put(x, 4, take(x, 4, ${lanes}) + whitened * yc)
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
    turn = 0.0  # of the angle: its gain (`angle_error.recall_angle`)
    for i in range(4):
        turn -= work[_GRADIENT + i] * work[_Y + i] / root
    work[_ANGLE_VARIANCE] += (sc * turn - 2.0 * seen) * turn
    share = (sc * turn - seen) / root
    put(work, _ANGLE, take(work, _ANGLE, 4) + share * ys - turn * cs)
    put(work, _ANGLE + 4, take(work, _ANGLE + 4, ${lanes}) + share * yc - turn * cc)
    exchange(c, _B, _V, work)
    return whitened


${measures}


@compiled
def recall(k, innovation, noise, estimate, work):
    """Take in a measurement of constant k."""
    p, c = estimate.p, estimate.c
    row = _W * (STATES + k)
    column = STATES + k
    ps = gather((p[column], p[_W + column], p[2 * _W + column], p[3 * _W + column]))
    cs = gather((c[column], c[_W + column], c[2 * _W + column], c[3 * _W + column]))
    pc = take(p, row + 4, ${lanes})
    cc = take(c, row + 4, ${lanes})
    sp = p[row + column] + noise
    sc = c[row + column] + noise
    take_in(innovation, Projected(ps, pc, sp, cs, cc, sc, work[_ANGLE + column]), estimate, work)


@inlined
def correct(settings, constants, estimate, sample, work, row):
    """Update state and covariances with the sample (NaN: no measurement); innovation and its variance go to the output
    row.
    """
    prior, spread, initial = constants.prior, constants.spread, constants.initial
    x, p, covariance, memory = estimate.x, estimate.p, estimate.c, estimate.memory
    z, u, h = sample.z, sample.u, sample.h
${sense}
    measured = False
${innovations}
    if not measured:
        return
    nis = 0.0
    moved = 0.0
    if np.isfinite(z[0]):
        white, other = measure_0(row.nu[0], settings.noise[0], estimate, work)
        moved = white * other
        nis += 0.5 * white * white
    if np.isfinite(z[1]):
        white, other = measure_1(row.nu[1] - moved, settings.noise[1], estimate, work)
        nis += 0.5 * white * white
    memory.nis += (nis - memory.nis) * ATTENTION
    memory.cursor = (memory.cursor + 1) % CONSTANTS
    k = memory.cursor
    if prior[k] > 0.0:  # else known exactly from the start: nothing is forgotten of it
        recall(k, initial[k] - x[STATES + k], prior[k], estimate, work)
    for k in range(CONSTANTS):
        variance = p[(_W + 1) * (STATES + k)]
        if spread[k] > 0.0 and variance > spread[k]:
            noise = variance * spread[k] / (variance - spread[k])
            recall(k, initial[k] - x[STATES + k], noise, estimate, work)


@inlined
def advance(settings, constants, estimate, sample, work, row):
    """`estimator.kernel.block.advance` with flat covariances and a state vector that is filled up."""
    x, memory, h = estimate.x, estimate.memory, sample.h
    predict(settings, constants.intensity, estimate, sample.u, h, work)
    note_forced_rotation(settings, memory, x, h)
    note_gradient(settings, memory, x)
    for i in range(4):
        work[_GRADIENT + i] = memory.gradient[i]
    correct(settings, constants, estimate, sample, work, row)
    memory.time += h
    read_angle(settings, memory, x, h, row)
    if refer_angle(settings, memory):
        for i in range(_ANGLE, _ANGLE_VARIANCE + 1):
            work[i] = 0.0
    row.angle_variance = work[_ANGLE_VARIANCE] / settings.angular_gain**2


@compiled
def observe_block(
    settings_record, intensity, prior, spread, initial, x, p, c, memory_record, z, u, h, temperature, rows, states_out,
    deviations_out, every,
):
    """`estimator.kernel.block.observe_block` of this step."""
    settings = settings_record[0]
    memory = memory_record[0]
    constants = Constants(intensity, prior, spread, initial)
    flat_x, flat_p, flat_c, work = unpacked(x, p, c, memory, True)
    estimate = Estimate(flat_x, flat_p, flat_c, memory)
    written = 0
    for m in range(z.shape[0]):
        if temperature.shape[0] > 0:
            memory.temperature = temperature[m]
        driven = u[m, 0, 0] != 0.0 or u[m, 1, 0] != 0.0
        memory.virtual_applied = virtual_rate(settings, memory.time) if settings.control == 1 and driven else 0.0
        advance(settings, constants, estimate, Sample(z[m], u[m], h[m]), work, rows[m])
        if m % every == every - 1:
            restore(flat_x, flat_p, flat_c, work, x, p, c, memory)
            for i in range(SIZE):
                states_out[written, i] = x[i]
                deviations_out[written, i] = math.sqrt(c[i, i])
            written += 1
    restore(flat_x, flat_p, flat_c, work, x, p, c, memory)
    return written


@compiled
def tick(settings_record, intensity, prior, spread, initial, x, p, c, memory_record, vx, vy, ux, uy, rows, codes):
    """`estimator.kernel.block.tick` of this step."""
    settings = settings_record[0]
    memory = memory_record[0]
    drive = np.zeros((2, 1))
    drive[0, 0] = ux * settings.quantum
    drive[1, 0] = uy * settings.quantum
    z = np.zeros(2)
    z[0] = vx * settings.sense_scale[0]
    z[1] = vy * settings.sense_scale[1]
    advance_queue(settings, memory, drive[:, 0])
    flat_x, flat_p, flat_c, work = unpacked(x, p, c, memory, True)
    constants = Constants(intensity, prior, spread, initial)
    estimate = Estimate(flat_x, flat_p, flat_c, memory)
    advance(settings, constants, estimate, Sample(z, drive, settings.h), work, rows[0])
    restore(flat_x, flat_p, flat_c, work, x, p, c, memory)
    command(settings, memory, x, workspace(settings, p.shape[0], x.shape[0]), codes)
'''
