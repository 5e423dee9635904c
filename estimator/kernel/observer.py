"""The discrete observer (7)(8) of TW I384198 B1: X̂[m+1] = f_d(X̂[m]) + B_d U[m] + L[m] (Z[m] − H X̂[m]).

The gain L comes from an extended Kalman filter, from one with fading memory (Bar-Shalom, Li & Kirubarajan, 2001), or
from a table derived once from the dynamics.  Beside the filter's covariance P runs the covariance C that the estimates
really have under that gain, C ← (I − LH)(F C Fᵀ + Q)(I − LH)ᵀ + L R Lᵀ: with fading memory P is about twice C, with a
tabulated gain there is no P at all.  Intervals are reported from C; for the plain EKF the two are one and only P is
carried.
"""

import math

import numpy as np

from estimator.kernel.angle_error import correct_angle, move_angle, predict_angle, recall_angle, turn_angle
from estimator.kernel.compiled import compiled, generated, inlined
from estimator.kernel.drifts import LENGTHS, OF_A_LENGTH
from estimator.kernel.flow import begin_ways, drive_at, flow, sensed_before
from estimator.kernel.lanes import lane, put, put_columns, take
from estimator.kernel.layout import MAX_AXES, MAX_DEGREE, MAX_SIGNALS, MAX_SLIPS, Floats, Ints, Record
from estimator.kernel.pattern import phase_and_angle
from estimator.kernel.sensing import sensed_otherwise, senses_otherwise
from estimator.kernel.signals import advance_signals, signal_values
from estimator.kernel.structures import Constants, Estimate, FlowWork, Interval, Push, Sample, Workspace

_sense = generated().sense
_jump = generated().jump
_effect_sense = generated().effect_sense

# The smoothed NIS is 1 ± 0.16 when the covariance is right: 3 is never reached by chance.
_LARGE_NIS = 3.0
ATTENTION = 0.05
_FASTEST = 0.1


@compiled
def propagate(p: Floats, g: Floats, scratch: Floats, factor: float) -> None:
    """p ← factor · F p Fᵀ with F = [gᵀ; 0 I]: only the rows of the states change; g (n, states), scratch (2 · states,
    p's width).
    """
    n, states = g.shape
    if states == 4:
        propagate_two(p, g, scratch)
    else:
        for i in range(states):
            for j in range(n):
                scratch[i, j] = 0.0
            for k in range(n):
                w = g[k, i]
                if w != 0.0:  # the sense offsets move nothing
                    for j in range(n):
                        scratch[i, j] += w * p[k, j]
        for i in range(states):
            for j in range(i, states):
                total = 0.0
                for k in range(n):
                    total += scratch[i, k] * g[k, j]
                p[i, j] = total
                p[j, i] = total
            for j in range(states, n):
                p[i, j] = scratch[i, j]
                p[j, i] = scratch[i, j]
    if factor != 1.0:
        for i in range(n):
            for j in range(n):
                p[i, j] *= factor


@inlined
def propagate_two(p: Floats, g: Floats, scratch: Floats) -> None:
    """p ← F p Fᵀ of two axes: T = gᵀ p, of which the constants' part is the states' new one, and their square T g."""
    n = g.shape[0]
    width = p.shape[1]
    stride = scratch.shape[1]
    fours = width - width % 4
    mirror = 4 * stride  # T, column by column
    for j in range(0, fours, 4):
        row, q = take(p, j, 4), take(g, 0, 4)
        t0, t1, t2, t3 = lane(q, 0) * row, lane(q, 1) * row, lane(q, 2) * row, lane(q, 3) * row
        for k in range(1, n):
            row, q = take(p, k * width + j, 4), take(g, 4 * k, 4)
            t0 = t0 + lane(q, 0) * row
            t1 = t1 + lane(q, 1) * row
            t2 = t2 + lane(q, 2) * row
            t3 = t3 + lane(q, 3) * row
        put(scratch, j, t0)
        put(scratch, stride + j, t1)
        put(scratch, 2 * stride + j, t2)
        put(scratch, 3 * stride + j, t3)
        put_columns(scratch, mirror + 4 * j, t0, t1, t2, t3)
    for j in range(fours, n):
        column = p[0, j] * take(g, 0, 4)
        for k in range(1, n):
            column = column + p[k, j] * take(g, 4 * k, 4)
        put(scratch, mirror + 4 * j, column)
    column, q = take(scratch, mirror, 4), take(g, 0, 4)
    t0, t1, t2, t3 = lane(column, 0) * q, lane(column, 1) * q, lane(column, 2) * q, lane(column, 3) * q
    for k in range(1, n):
        column, q = take(scratch, mirror + 4 * k, 4), take(g, 4 * k, 4)
        t0 = t0 + lane(column, 0) * q
        t1 = t1 + lane(column, 1) * q
        t2 = t2 + lane(column, 2) * q
        t3 = t3 + lane(column, 3) * q
    put(p, 0, t0)
    put(p, width, t1)
    put(p, 2 * width, t2)
    put(p, 3 * width, t3)
    for i in range(4):
        for j in range(i + 1, 4):
            p[j, i] = p[i, j]
        for j in range(4, fours, 4):
            put(p, i * width + j, take(scratch, i * stride + j, 4))
    for j in range(fours, n):
        column = take(scratch, mirror + 4 * j, 4)
        p[0, j], p[1, j], p[2, j], p[3, j] = lane(column, 0), lane(column, 1), lane(column, 2), lane(column, 3)
    for j in range(4, n):
        put(p, j * width, take(scratch, mirror + 4 * j, 4))


@compiled
def add_process_noise(
    p: Floats, settings: Record, h: float, s: Floats, active: Ints, intensity: Floats, jump: Floats
) -> None:
    """Force noise on the velocities, random walks on the constants; the rate's moves the velocities, too (Ω̇ r)."""
    states = settings.states
    for axis in range(settings.axes):
        q = settings.force_noise[axis]
        i = 2 * axis
        p[i, i] += q * h * h * h / 3.0
        p[i, i + 1] += q * h * h / 2.0
        p[i + 1, i] += q * h * h / 2.0
        p[i + 1, i + 1] += q * h
    for k in range(active.shape[0]):
        q = intensity[k] * h
        if q == 0.0:
            continue
        row = states + k
        p[row, row] += q
        _jump(settings.model, s, active[k], jump)
        for i in range(states):
            if jump[i] != 0.0:
                p[row, i] += q * jump[i]
                p[i, row] += q * jump[i]
                for j in range(states):
                    p[i, j] += q * (jump[i] * jump[j])  # in this order: the same in both triangles


@compiled
def kalman_gain(p: Floats, jacobian: Floats, noise: Floats, channels: int, nu: Floats, gain: Floats) -> float:
    """gain ← p Hᵀ S⁻¹ with S = H p Hᵀ + R for one or two channels; returns νᵀ S⁻¹ ν per channel, expected 1."""
    n = p.shape[0]
    for a in range(channels):
        for i in range(n):
            gain[i, a] = 0.0
        for j in range(n):
            w = jacobian[a, j]
            if w != 0.0:
                for i in range(n):
                    gain[i, a] += w * p[j, i]
    s00 = noise[0]
    for j in range(n):
        s00 += jacobian[0, j] * gain[j, 0]
    nis: float
    if channels == 1:
        for i in range(n):
            gain[i, 0] /= s00
        nis = nu[0] * nu[0] / s00
        return nis
    s11 = noise[1]
    s01 = 0.0
    for j in range(n):
        s01 += jacobian[0, j] * gain[j, 1]
        s11 += jacobian[1, j] * gain[j, 1]
    determinant = s00 * s11 - s01 * s01
    for i in range(n):
        g0 = gain[i, 0]
        g1 = gain[i, 1]
        gain[i, 0] = (g0 * s11 - g1 * s01) / determinant
        gain[i, 1] = (g1 * s00 - g0 * s01) / determinant
    nis = 0.5 * (nu[0] * nu[0] * s11 - 2.0 * nu[0] * nu[1] * s01 + nu[1] * nu[1] * s00) / determinant
    return nis


@inlined
def measure_two(p: Floats, memory: Record, work: Workspace) -> float:
    """p ← p − p Hᵀ S⁻¹ H p with S = H p Hᵀ + R for two channels whose noise is independent, and gain ← p Hᵀ S⁻¹ of p as
    it was; variance ← S's diagonal; returns νᵀ S⁻¹ ν per channel, expected 1.  H, R and ν stand in work.

    One channel after the other, each with y = p h/√S: what is taken off, y yᵀ, is symmetric to the last bit.  The
    angle's uncertainty follows.
    """
    jacobian, noise, nu, variance = work.jacobian, work.noise, work.innovation, work.variance
    gain, seen = work.gain, work.projected
    n = p.shape[0]
    width = p.shape[1]
    fours = width - width % 4
    for a in range(2):
        for i in range(width):
            seen[a, i] = 0.0
        for j in range(n):
            w = jacobian[a, j]
            if w != 0.0:  # few are not
                for i in range(width):
                    seen[a, i] += w * p[j, i]
    s00, s01, s11 = noise[0], 0.0, noise[1]
    for j in range(n):
        s00 += jacobian[0, j] * seen[0, j]
        s01 += jacobian[1, j] * seen[0, j]
        s11 += jacobian[1, j] * seen[1, j]
    variance[0] = s00
    variance[1] = s11
    first = 1.0 / math.sqrt(s00)
    shared = first * s01  # y₀ · h₁
    rest = s11 - shared * shared
    second = 1.0 / math.sqrt(rest)
    for i in range(width):
        y = first * seen[0, i]
        seen[0, i] = y
        seen[1, i] = second * (seen[1, i] - shared * y)
    for i in range(n):
        gain[i, 1] = second * seen[1, i]
        gain[i, 0] = first * seen[0, i] - first * shared * gain[i, 1]
    turn_angle(memory, jacobian[0], seen[0], first)
    turn_angle(memory, jacobian[1], seen[1], second)
    stride = seen.shape[1]
    for i in range(n):
        y0, y1 = -seen[0, i], -seen[1, i]
        for j in range(0, fours, 4):
            left = take(p, i * width + j, 4) + y0 * take(seen, j, 4)
            put(p, i * width + j, left + y1 * take(seen, stride + j, 4))
        for j in range(fours, width if i >= fours else fours):
            p[i, j] = (p[i, j] + y0 * seen[0, j]) + y1 * seen[1, j]
    for i in range(fours):
        for j in range(fours, width):  # lanes may round a sum once where this loop rounds it twice
            p[i, j] = p[j, i]
    white = first * nu[0]
    other = second * (nu[1] - shared * white)
    nis: float = 0.5 * (white * white + other * other)
    return nis


@compiled
def fading_factor(settings: Record, memory: Record) -> float:
    """Factor on the predicted covariance: the chosen memory, shorter while the innovations deny the covariance.

    An innovation that stays several times larger than predicted means a change or a wrong start; forgetting faster
    until prediction and innovation agree is what lets the observer catch it (adaptive fading, Xia, Rao, Ying & Shen,
    Automatica 30(8), 1994).
    """
    fade: float = settings.fade
    if fade > 1.0 and memory.nis > _LARGE_NIS:
        fade *= 1.0 + min(0.01 * (memory.nis - _LARGE_NIS), _FASTEST)
    return fade


@compiled
def joseph(p: Floats, jacobian: Floats, noise: Floats, channels: int, gain: Floats, scratch: Floats) -> None:
    """p ← (I − KH) p (I − KH)ᵀ + K R Kᵀ, symmetric to the last bit and positive for any gain; scratch (4, n).

    With S = H p Hᵀ + R and W = p Hᵀ − ½ K S it is p − K Wᵀ − W Kᵀ.
    """
    n = p.shape[0]
    s01 = 0.0
    for a in range(channels):
        ph = scratch[a]
        for i in range(n):
            ph[i] = 0.0
            scratch[2 + a, i] = gain[i, a]
        for j in range(n):
            w = jacobian[a, j]
            if w != 0.0:  # few are not
                for i in range(n):
                    ph[i] += w * p[j, i]
    s00 = noise[0]
    for j in range(n):
        s00 += jacobian[0, j] * scratch[0, j]
    if channels == 1:
        for i in range(n):
            scratch[0, i] -= 0.5 * s00 * gain[i, 0]
        subtract_products(p, scratch[2], scratch[0])
        return
    s11 = noise[1]
    for j in range(n):
        s01 += jacobian[0, j] * scratch[1, j]
        s11 += jacobian[1, j] * scratch[1, j]
    for i in range(n):
        scratch[0, i] -= 0.5 * (s00 * gain[i, 0] + s01 * gain[i, 1])
        scratch[1, i] -= 0.5 * (s01 * gain[i, 0] + s11 * gain[i, 1])
    subtract_products(p, scratch[2], scratch[0])
    subtract_products(p, scratch[3], scratch[1])


@compiled
def subtract_products(p: Floats, k: Floats, w: Floats) -> None:
    """p ← p − k wᵀ − w kᵀ, both triangles: along contiguous rows that costs less than one triangle and its mirror, and
    rounds alike in both.
    """
    n = p.shape[0]
    for i in range(n):
        ki = k[i]
        wi = w[i]
        for j in range(n):
            p[i, j] -= ki * w[j] + wi * k[j]


@compiled
def rank_one(p: Floats, row: int, gain: Floats, noise: float, scratch: Floats) -> None:
    """Joseph update of p for a direct measurement of entry `row` with variance `noise` and any gain (n,); scratch
    (n,).
    """
    half = 0.5 * (p[row, row] + noise)
    for i in range(p.shape[0]):
        scratch[i] = p[row, i] - half * gain[i]
    subtract_products(p, gain, scratch)


@compiled
def recall_initial(
    settings: Record, active: Ints, index: int, initial: float, noise: float, estimate: Estimate, scratch: Floats
) -> None:
    """Measure one constant against its initial value, with variance `noise`; scratch (2 or more, n)."""
    x, p, c = estimate.x, estimate.p, estimate.c
    row = settings.states + index
    gain = scratch[0]
    share = 1.0 / (p[row, row] + noise)
    pull = initial - x[settings.states + active[index]]
    for i in range(p.shape[0]):
        gain[i] = p[row, i] * share
        x[i if i < settings.states else settings.states + active[i - settings.states]] += gain[i] * pull
    if settings.axes == 2:
        recall_angle(estimate.memory, c if settings.two_covariances == 1 else p, row, gain, noise)
    rank_one(p, row, gain, noise, scratch[1])
    if settings.two_covariances == 1:
        rank_one(c, row, gain, noise, scratch[1])


@compiled
def remember_prior(settings: Record, active: Ints, constants: Constants, estimate: Estimate, scratch: Floats) -> None:
    """Give back what fading memory forgot of the initial values.

    Fading memory forgets in every direction but learns only in excited ones.  One constant after the other is measured
    against its initial value with just the information that was forgotten (prior, its variance): P stays bounded by
    about the initial spread and an unexcited constant returns to that value instead of drifting (stabilised forgetting,
    Kulhavý & Zarrop, Int. J. Control 58(4), 1993; one direction at a time as in Gunnarsson, CDC 1996).  A constant
    whose variance has passed its initial one (a large memory.nis had the filter forget in haste) is brought back to it
    at once.
    """
    prior, spread, initial = constants.prior, constants.spread, constants.initial
    memory, p = estimate.memory, estimate.p
    memory.cursor = (memory.cursor + 1) % active.shape[0]
    k = memory.cursor
    if prior[k] > 0.0:  # else known exactly from the start: nothing is forgotten of it
        recall_initial(settings, active, k, initial[k], prior[k], estimate, scratch)
    for k in range(active.shape[0]):
        variance = p[settings.states + k, settings.states + k]
        if spread[k] > 0.0 and variance > spread[k]:
            noise = variance * spread[k] / (variance - spread[k])
            recall_initial(settings, active, k, initial[k], noise, estimate, scratch)


@compiled
def tabulated_gain(table: Floats, s: Floats, gain: Floats) -> None:
    """Stationary gain at the pattern angle and vibration phase of s, bilinear in the table (angle, phase, n, channel).

    The pattern angle is known modulo π; θ + π with phase + π is the same motion, which is what the wrap uses.
    """
    angles, phases, n, channels = table.shape
    theta, phase = phase_and_angle(s, 1.0)
    u = (theta + 0.5 * np.pi) / np.pi * angles
    v = (phase + np.pi) / (2.0 * np.pi) * phases
    i0 = int(np.floor(u))
    j0 = int(np.floor(v))
    fu = u - i0
    fv = v - j0
    for i in range(n):
        for a in range(channels):
            gain[i, a] = 0.0
    for di in range(2):
        row = i0 + di
        shift = 0
        if row >= angles:
            row -= angles
            shift = phases // 2
        wu = fu if di == 1 else 1.0 - fu
        for dj in range(2):
            column = (j0 + dj + shift) % phases
            w = wu * (fv if dj == 1 else 1.0 - fv)
            for i in range(n):
                for a in range(channels):
                    gain[i, a] += w * table[row, column, i, a]


@compiled
def runs_riccati(settings: Record, memory: Record) -> bool:
    """Whether the gain comes from the covariance recursion: always, but for a table that has taken over."""
    tabulated: bool = settings.stationary == 1 and memory.time >= settings.takeover
    return not tabulated


@compiled
def filled_up(n: int) -> int:
    """The next multiple of four, so that rows fill vector registers."""
    return (n + 3) // 4 * 4


@compiled
def widened(p: Floats) -> Floats:
    """A covariance (n, n) with rows filled up to a multiple of four by zeros, which they stay."""
    n = p.shape[0]
    wide = np.zeros((n, filled_up(n)))
    for i in range(n):
        for j in range(n):
            wide[i, j] = p[i, j]
    return wide


@compiled
def narrowed(wide: Floats, p: Floats) -> None:
    """p (n, n) ← a widened one."""
    for i in range(p.shape[0]):
        for j in range(p.shape[0]):
            p[i, j] = wide[i, j]


@compiled
def pushless(states: int, constants: int, columns: int) -> Push:
    """A `Push` of nothing yet, in a flow of so many columns."""
    return Push(
        force=np.zeros(MAX_AXES),
        by_states=np.zeros((2, states)),
        by_constants=np.zeros((2, constants)),
        drive=np.zeros(MAX_AXES),
        signals=np.zeros(2 * MAX_SIGNALS),
        slips=np.zeros((MAX_SLIPS, columns)),
    )


@compiled
def flow_work(settings: Record, constants: int, columns: int) -> FlowWork:
    """Scratch of a flow in so many columns, of a model with so many constants, effects' coefficients included.

    The rows of derivatives by constants are as long as columns in lanes reach.
    """
    states = settings.states
    constants = max(constants, columns + settings.sense_constants - states)
    return FlowWork(
        term=np.zeros((states, columns)),
        other=np.zeros((states, columns)),
        out=np.zeros((states, columns)),
        push=pushless(states, constants, columns),
        state=np.zeros(states),
        powers=np.zeros((settings.order + 1, 16)),
        drifts=np.zeros((LENGTHS, OF_A_LENGTH)),
        entries=np.zeros((4, 8)),
    )


@compiled
def workspace(settings: Record, n: int, total: int) -> Workspace:
    """Scratch of one observer, made once per block; n counts states and active constants, total states and all
    constants.  What has lanes is filled up to a multiple of four.
    """
    states = settings.states
    columns = 1 + states + settings.flow_constants
    if states == 4:
        columns = filled_up(columns)
    width = filled_up(n)
    return Workspace(
        flow=flow_work(settings, total - states, columns),
        transition=np.zeros((n, states)),
        rows=np.zeros((2 * states, width)),
        projected=np.zeros((4, width)),
        jacobian=np.zeros((2, n)),
        full=np.zeros((2, total)),
        gain=np.zeros((n, 2)),
        jump=np.zeros(states),
        before=np.zeros(states),
        predicted=np.zeros(MAX_AXES),
        noise=np.zeros(MAX_AXES),
        assumed=np.zeros(MAX_AXES),
        innovation=np.zeros(MAX_AXES),
        variance=np.zeros(MAX_AXES),
    )


@inlined
def predict_state(
    settings: Record, active: Ints, memory: Record, x: Floats, u: Floats, h: float, work: Workspace
) -> None:
    """Move x over one interval and leave in work the Jacobian rows of the states over [states, active constants]."""
    states = settings.states
    out, g = work.flow.out, work.transition
    signal_values(settings, memory, memory.time, work.flow.push.signals)
    interval = Interval(memory.time, h, u)
    slips = work.flow.push.slips
    for k in range(settings.slip_count):
        slips[k, 0] = memory.signals[settings.slips[k, 0], 0]
    if memory.time == 0.0 and settings.slip_count > 0:
        begin_ways(settings, x[states:], x[:states], 1, slips)
    flow(settings, interval, memory.past[:], x[states:], x[:states], out.shape[1], work.flow)
    for k in range(settings.slip_count):
        memory.signals[settings.slips[k, 0], 0] = slips[k, 0]
    for i in range(states):
        x[i] = out[i, 0]
        for j in range(states):
            g[j, i] = out[i, 1 + j]
        for k in range(active.shape[0]):
            offset = active[k] - settings.sense_constants
            g[states + k, i] = out[i, 1 + states + offset] if offset >= 0 else 0.0


@inlined
def sense_effects(settings: Record, memory: Record, x: Floats, u: Floats, h: float, work: Workspace) -> None:
    """Add to predicted measurement and Jacobian in work what the effects do to the measurement at the end of the
    interval.
    """
    states = settings.states
    out, full, predicted = work.flow.out, work.full, work.predicted
    drive, signals = work.flow.push.drive, work.flow.push.signals
    c, s = x[states:], x[:states]
    by_states, by_constants = full[:, :states], full[:, states:]
    drive_at(u, 1.0, drive)
    signal_values(settings, memory, memory.time + h, signals)
    for e in range(settings.effect_count):
        number, first, signal = settings.effects[e]
        _effect_sense(
            number, settings.model, c, s, drive, signals, first, signal, predicted, by_states, by_constants
        )  # fmt: skip
    if settings.sense_delay >= 0:
        for axis in range(settings.axes):
            row = 2 * axis
            interval = Interval(memory.time + h, h, u)
            sensed_before(settings, interval, memory.past[:], c, x[:states], axis, work.flow)
            predicted[axis] += out[row, 0] - x[row]
            full[axis, row] -= 1.0
            for j in range(states + settings.flow_constants):
                full[axis, j if j < states else j + settings.sense_constants] += out[row, 1 + j]
            full[axis, states + settings.sense_delay + axis] -= out[row + 1, 0]


@inlined
def predict_measurement(
    settings: Record, active: Ints, memory: Record, x: Floats, sample: Sample, work: Workspace
) -> bool:
    """Innovation (0 where z is NaN), measurement Jacobian over [states, active constants] and noise into work; False
    if z is all NaN.
    """
    z, u, h = sample.z, sample.u, sample.h
    states = settings.states
    jacobian, full, predicted, push = work.jacobian, work.full, work.predicted, work.flow.push
    nu, noise = work.innovation, work.noise
    full[:] = 0.0
    if senses_otherwise(settings):
        drive_at(u, 1.0, push.drive)
        signal_values(settings, memory, memory.time + h, push.signals)
        sensed_otherwise(settings, x[states:], x[:states], push, predicted, full[:, :states], full[:, states:])
    else:
        _sense(settings.model, x[states:], x[:states], predicted, full)
        if settings.effect_count > 0:
            sense_effects(settings, memory, x, u, h, work)
    measured = False
    for channel in range(settings.axes):
        usable = np.isfinite(z[channel])
        measured = measured or usable
        nu[channel] = z[channel] - predicted[channel] if usable else 0.0
        noise[channel] = settings.noise[channel]
        for j in range(states):
            jacobian[channel, j] = full[channel, j] if usable else 0.0
        for k in range(active.shape[0]):
            jacobian[channel, states + k] = full[channel, states + active[k]] if usable else 0.0
    return measured


@inlined
def predict(
    settings: Record, active: Ints, intensity: Floats, estimate: Estimate, u: Floats, h: float, work: Workspace
) -> None:
    """Advance state and covariances over h with the drive u (axes, degree + 1) that acted."""
    x, p, c, memory = estimate.x, estimate.p, estimate.c, estimate.memory
    g = work.transition
    s = x[: settings.states]
    work.before[:] = s
    predict_state(settings, active, memory, x, u, h, work)
    if settings.signal_count > 0:
        advance_signals(settings, memory, x[settings.states :], u, h)
    if settings.axes == 2:
        predict_angle(settings, memory, c if settings.two_covariances == 1 else p, h)
        move_angle(memory, g)
    if settings.two_covariances == 1:
        propagate(c, g, work.rows, 1.0)
        add_process_noise(c, settings, h, s, active, intensity, work.jump)
    if runs_riccati(settings, memory):
        propagate(p, g, work.rows, fading_factor(settings, memory))
        add_process_noise(p, settings, h, s, active, intensity, work.jump)


@inlined
def correct(
    settings: Record,
    active: Ints,
    constants: Constants,
    table: Floats,
    estimate: Estimate,
    sample: Sample,
    work: Workspace,
) -> None:
    """Update state and covariances with the sample (NaN: no measurement); work receives innovation and its variance."""
    x, p, c, memory = estimate.x, estimate.p, estimate.c, estimate.memory
    nu, variance = work.innovation, work.variance
    jacobian, gain, ph, noise, assumed = work.jacobian, work.gain, work.projected, work.noise, work.assumed
    states = settings.states
    channels = settings.axes
    n = p.shape[0]
    measured = predict_measurement(settings, active, memory, x, sample, work)
    actual = c if settings.two_covariances == 1 else p
    riccati = runs_riccati(settings, memory)
    for channel in range(channels):
        assumed[channel] = noise[channel] + settings.ignored[channel]
    if measured and riccati and channels == 2 and settings.two_covariances == 0:
        nis = measure_two(p, memory, work)
        memory.nis += (nis - memory.nis) * ATTENTION
        add_correction(states, active, gain, nu, channels, x)
    else:
        for channel in range(channels):
            variance[channel] = noise[channel]
            for i in range(n):
                if jacobian[channel, i] != 0.0:
                    for j in range(n):
                        if jacobian[channel, j] != 0.0:
                            variance[channel] += jacobian[channel, i] * actual[i, j] * jacobian[channel, j]
        if not measured:
            return
        if riccati:
            nis = kalman_gain(p, jacobian, assumed, channels, nu, gain)
            memory.nis += (nis - memory.nis) * ATTENTION
        else:
            tabulated_gain(table, x[:states], gain)
            for channel in range(channels):
                if not np.isfinite(sample.z[channel]):
                    gain[:, channel] = 0.0
        add_correction(states, active, gain, nu, channels, x)
        if channels == 2:
            correct_angle(memory, actual, jacobian, noise, channels, gain, ph)
        if settings.two_covariances == 1:
            joseph(c, jacobian, noise, channels, gain, ph)
        if riccati:
            joseph(p, jacobian, assumed, channels, gain, ph)
    if riccati and settings.fade > 1.0 and active.shape[0] > 0:
        remember_prior(settings, active, constants, estimate, ph)


@inlined
def add_correction(states: int, active: Ints, gain: Floats, nu: Floats, channels: int, x: Floats) -> None:
    """x, all constants in it, plus gain (n, channels) times the innovation."""
    for i in range(gain.shape[0]):
        correction = 0.0
        for channel in range(channels):
            correction += gain[i, channel] * nu[channel]
        x[i if i < states else states + active[i - states]] += correction


@compiled
def remember_drive(settings: Record, memory: Record, u: Floats) -> None:
    """Keep the drive of the interval that has ended, for a path that is late."""
    if settings.drive_delay >= 0 or settings.sense_delay >= 0 or settings.watched_drive_delay >= 0:
        shift_drives(memory.past[:], u)


@compiled
def shift_drives(past: Floats, u: Floats) -> None:
    """past (intervals, axes, terms), newest first, gets u in front and loses its oldest."""
    for j in range(past.shape[0] - 1, 0, -1):
        past[j] = past[j - 1]
    past[0] = 0.0
    for axis in range(u.shape[0]):
        for n in range(min(u.shape[1], MAX_DEGREE)):
            past[0, axis, n] = u[axis, n]
