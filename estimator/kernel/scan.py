"""The observer's run over a block of samples with the signatures of effects it does not carry.

The signature of a coefficient is what the innovations would gain if it were 1: a small change of force or measurement
moves prediction and correction alike, δx⁻ = F δx + Γ, δν = −(H δx⁻ + η), δx⁺ = δx⁻ + L δν (Willsky & Jones, IEEE Trans.
Automatic Control 21(1), 1976, for jumps).  What the filter's own states and constants can take up is projected out by
the filter itself.  The sums N = Σ δν S⁻¹ δνᵀ and b = Σ δν S⁻¹ ν are the normal equations of all coefficients at once.

The reported angle is followed the same way: from one sample to the next it moves by Ω̂ h, and by what the correction
turns the pattern (`estimator.kernel.angle`); the derivative of both along δx is what a coefficient would move it by.
"""

import math
from typing import NamedTuple

import numpy as np

from estimator.kernel.angle import note_forced_rotation, read_angle
from estimator.kernel.compiled import compiled, generated, inlined
from estimator.kernel.controller import virtual_rate
from estimator.kernel.flow import drive_at, part_of
from estimator.kernel.layout import RATE, Floats, Ints, Record
from estimator.kernel.observer import correct, predict, recall_initial, remember_drive, runs_riccati, workspace
from estimator.kernel.sensing import sensed_motion, senses_otherwise
from estimator.kernel.signals import directions, line_values, signal_values
from estimator.kernel.structures import Arrays, Constants, Estimate, Sample, Workspace
from estimator.kernel.taylor import taylor

_effect_force = generated().effect_force
_effect_sense = generated().effect_sense

# Gauss–Legendre on [0, 1], three nodes: exact to degree 5.
_NODES = (0.11270166537925831, 0.5, 0.88729833462074169)
_WEIGHTS = (0.27777777777777778, 0.44444444444444444, 0.27777777777777778)


class Block(NamedTuple):
    """n samples: measured z (n, axes), drive u (n, axes, degree + 1) over the interval that ends at each, its length h
    (n,), temperature (n,) or (0,); rows (n,) of OUTPUT receive the estimates.
    """

    z: Floats
    u: Floats
    h: Floats
    temperature: Floats
    rows: Record


class Signatures(NamedTuple):
    """What is followed of k coefficients that the filter does not carry.

    delta (states + active constants, k): sensitivity of the filter's estimates to them, carried on; turned (k,): that
    of the reported angle, of two axes, carried on and written to course (rows, k) at equal distances, the last time
    after the last sample.  equations (axes · n, k + 1) receive, where there are any, the innovations' sensitivities and
    behind them the innovation, all over its deviation; columns beyond are left alone.  Samples around an innovation
    larger than `level` times its variance count less, in proportion: a jump of the rate says nothing of an effect.
    """

    delta: Floats
    level: float
    equations: Floats
    turned: Floats
    course: Floats


class Following(NamedTuple):
    """`Signatures` while a block is gone through.

    origin: index of the first watched coefficient among the constants; rate_row: the rate's in delta, −1 for none;
    by_constants (2, constants) and gradient (5,) are scratch; signature (2, k) the innovations' sensitivities.
    """

    origin: int
    rate_row: int
    delta: Floats
    turned: Floats
    by_constants: Floats
    signature: Floats
    gradient: Floats


@inlined
def following(signatures: Signatures, origin: int, rate_row: int, constants: int) -> Following:
    """With scratch for so many constants."""
    delta = signatures.delta
    return Following(
        origin=origin,
        rate_row=rate_row,
        delta=delta,
        turned=signatures.turned,
        by_constants=np.zeros((2, constants)),
        signature=np.zeros((2, delta.shape[1])),
        gradient=np.zeros(5),
    )


@compiled
def responses(settings: Record, c: Floats, h: float, term: Floats, out: Floats) -> Floats:
    """What a unit impulse on each axis at the nodes (and, last, at the start) leaves at the end: (4, states, axes)."""
    states = settings.states
    response = np.zeros((len(_NODES) + 1, states, settings.axes))
    rest = np.zeros((settings.axes, 1))
    for node in range(len(_NODES) + 1):
        left = 1.0 - _NODES[node] if node < len(_NODES) else 1.0
        for axis in range(settings.axes):
            out[:, 0] = 0.0
            out[2 * axis + 1, 0] = 1.0
            taylor(settings.model, c, rest, left * h, settings.order, 1, term, out)
            for i in range(states):
                response[node, i, axis] = out[i, 0]
    return response


@compiled
def add_forced(
    settings: Record,
    memory: Record,
    before: Floats,
    x: Floats,
    sample: Sample,
    response: Floats,
    follow: Following,
    work: Workspace,
) -> None:
    """Add to the states' rows of delta what the watched forces push over the interval that has ended.

    before: the states at its beginning; x: the state vector at its end.
    """
    u, h = sample.u, sample.h
    origin, by_constants, delta = follow.origin, follow.by_constants, follow.delta
    states = settings.states
    out, push = work.flow.out, work.flow.push
    value, by_states, drive, signals = push.force, push.by_states, push.drive, push.signals
    c = x[states:]
    watched = delta.shape[1]
    state = np.empty(states)  # contiguous, as elsewhere: the forces are compiled for one kind of array
    for i in range(states):
        out[i, 0] = before[i]
    at = 0.0
    for node in range(len(_NODES)):
        length = _NODES[node] - at
        taylor(settings.model, c, part_of(u, at, length), length * h, settings.order, 1, work.flow.term, out)
        at = _NODES[node]
        for i in range(states):
            state[i] = out[i, 0]
        drive_at(u, at, drive)
        line_values(settings, memory.time + (at - 1.0) * h, signals)
        directions(settings, state, signals)
        by_constants[:] = 0.0
        for e in range(settings.effect_count, settings.effect_count + settings.candidate_count):
            number, first, signal = settings.effects[e]
            _effect_force(
                number, settings.model, c, state, drive, signals, first, signal, value, by_states, by_constants
            )
        if settings.watched_drive_delay >= 0:
            slope = np.zeros(settings.axes)
            for axis in range(settings.axes):
                for n in range(u.shape[1] - 1, 0, -1):
                    slope[axis] = slope[axis] * at + n * u[axis, n]
                by_constants[axis, settings.watched_drive_delay + axis] -= slope[axis] / h
        weight = _WEIGHTS[node] * h
        for axis in range(settings.axes):
            for i in range(states):
                share = weight * response[node, i, axis]
                for k in range(watched):
                    delta[i, k] += share * by_constants[axis, origin + k]
    if settings.watched_drive_delay >= 0:
        last = len(_NODES)
        for axis in range(settings.axes):
            ended = 0.0
            for n in range(u.shape[1]):
                ended += memory.past[1, axis, n]
            k = settings.watched_drive_delay + axis - origin
            for i in range(states):
                delta[i, k] += response[last, i, axis] * (ended - u[axis, 0])


@compiled
def watch_sensed(settings: Record, x: Floats, u: Floats, follow: Following, work: Workspace) -> None:
    """signature ← less what the watched effects add to the measurement at the interval's end."""
    origin, by_constants, signature = follow.origin, follow.by_constants, follow.signature
    states = settings.states
    push = work.flow.push
    value, by_states, drive, signals = push.force, push.by_states[:, :states], push.drive, push.signals
    c, s = x[states:], x[:states]
    added = by_constants[:, : len(c)]  # a part of it, as the observer's is: the kernel is one for both
    drive_at(u, 1.0, drive)
    if senses_otherwise(settings):
        s, _ = sensed_motion(settings, c, s, push)
    by_constants[:] = 0.0
    for e in range(settings.effect_count, settings.effect_count + settings.candidate_count):
        number, first, signal = settings.effects[e]
        _effect_sense(number, settings.model, c, s, drive, signals, first, signal, value, by_states, added)
    if settings.watched_sense_delay >= 0:
        for axis in range(settings.axes):
            by_constants[axis, settings.watched_sense_delay + axis] -= s[2 * axis + 1]
    for axis in range(settings.axes):
        for k in range(signature.shape[1]):
            signature[axis, k] = -by_constants[axis, origin + k]


@compiled
def multiply_rows(g: Floats, delta: Floats, scratch: Floats) -> None:
    """First rows of delta ← gᵀ delta; delta (n, coefficients), g (n, rows)."""
    n, rows = g.shape
    scratch[:rows] = 0.0
    for i in range(rows):
        for j in range(n):
            w = g[j, i]
            for k in range(delta.shape[1]):
                scratch[i, k] += w * delta[j, k]
    for i in range(rows):
        for k in range(delta.shape[1]):
            delta[i, k] = scratch[i, k]


@compiled
def pattern_gradient(s: Floats, k: float, w: float, rate: float, out: Floats) -> None:
    """out (5,) ← derivatives of the pattern angle θ by x, ẋ, y, ẏ and by the rate, of which the rotation w is a part.

    Of `estimator.kernel.pattern.pattern`; zero where there is no pattern.
    """
    x = s[0]
    y = s[2]
    vx = s[1] - w * y
    vy = s[3] + w * x
    ke = k + w * w - rate * rate
    sine = 2.0 * (ke * x * y + vx * vy)
    cosine = ke * (x * x - y * y) + vx * vx - vy * vy
    size = sine * sine + cosine * cosine
    if not size > 0.0:
        out[:] = 0.0
        return
    by_vx = (cosine * vy - sine * vx) / size
    by_vy = (cosine * vx + sine * vy) / size
    by_ke = (cosine * x * y - 0.5 * sine * (x * x - y * y)) / size
    out[0] = ke * (cosine * y - sine * x) / size + by_vy * w
    out[1] = by_vx
    out[2] = ke * (cosine * x + sine * y) / size - by_vx * w
    out[3] = by_vy
    out[4] = by_vy * x - by_vx * y + 2.0 * (w - rate) * by_ke


@compiled
def add_turn(settings: Record, s: Floats, w: float, rate: float, sign: float, follow: Following) -> None:
    """turned += sign · ∂θ along delta, at the states s and the rotation w."""
    delta, turned, gradient, row = follow.delta, follow.turned, follow.gradient, follow.rate_row
    pattern_gradient(s, settings.stiffness, w, rate, gradient)
    for i in range(4):
        g = sign * gradient[i]
        for k in range(turned.shape[0]):
            turned[k] += g * delta[i, k]
    if row >= 0:
        g = sign * gradient[4]
        for k in range(turned.shape[0]):
            turned[k] += g * delta[row, k]


@compiled
def recall(
    settings: Record, active: Ints, constants: Constants, estimate: Estimate, scratch: Floats, delta: Floats
) -> None:
    """`estimator.kernel.observer.remember_prior`, the sensitivities pulled along; the cursor has moved on already."""
    prior, spread, initial = constants.prior, constants.spread, constants.initial
    p, memory = estimate.p, estimate.memory
    for turn in range(active.shape[0] + 1):
        index = memory.cursor if turn == 0 else turn - 1
        row = settings.states + index
        noise = prior[index]
        if turn > 0:
            variance = p[row, row]
            wide = spread[index] > 0.0 and variance > spread[index]
            noise = variance * spread[index] / (variance - spread[index]) if wide else 0.0
        if noise > 0.0:
            recall_initial(settings, active, index, initial[index], noise, estimate, scratch)
            pull(delta, row, scratch[0])


@compiled
def pull(delta: Floats, row: int, gain: Floats) -> None:
    """delta after a measurement of constant `row` against an initial value that no coefficient moves."""
    for k in range(delta.shape[1]):
        moved = delta[row, k]
        for j in range(delta.shape[0]):
            delta[j, k] -= gain[j] * moved


@compiled
def scan_block(observer: Arrays, block: Block, signatures: Signatures) -> None:
    """Observe n samples as `estimator.kernel.block.observe_block` does, and follow what is watched."""
    settings = observer.settings[0]
    memory = observer.memory[0]
    active, x = observer.active, observer.x
    constants = Constants(observer.intensity, observer.prior, observer.spread, observer.initial)
    nothing = np.zeros(active.shape[0])
    forgetful = Constants(observer.intensity, nothing, nothing, observer.initial)
    estimate = Estimate(x, observer.p, observer.c, memory)
    z, u, h, temperature, rows = block
    level, equations, turned, course = signatures.level, signatures.equations, signatures.turned, signatures.course
    delta = signatures.delta
    states = settings.states
    work = workspace(settings, observer.p.shape[0], x.shape[0])
    nu, variance, signals = work.innovation, work.variance, work.flow.push.signals
    jacobian, gain = work.jacobian, work.gain
    count = delta.shape[1]
    scratch = np.zeros((2 if states < 2 else states, count))
    response = responses(settings, x[states:], h[0], work.flow.term, work.flow.out)
    length = h[0]
    weighed = equations.shape[0] > 0
    foreseen = np.zeros(states)
    rate_row = -1
    if settings.axes == 2:
        for i in range(active.shape[0]):
            if active[i] == RATE:
                rate_row = states + i
    follow = following(signatures, x.shape[0] - states - count, rate_row, x.shape[0] - states)
    signature = follow.signature
    written = 0
    for m in range(z.shape[0]):
        if temperature.shape[0] > 0:
            memory.temperature = temperature[m]
        if h[m] != length:
            length = h[m]
            response = responses(settings, x[states:], length, work.flow.term, work.flow.out)
        turning = settings.axes == 2 and memory.started == 1
        if settings.axes == 2:
            driven = u[m, 0, 0] != 0.0 or u[m, 1, 0] != 0.0
            memory.virtual_applied = virtual_rate(settings, memory.time) if settings.control == 1 and driven else 0.0
        rotation = memory.rotation
        rate = memory.rate
        sample = Sample(z[m], u[m], h[m])
        predict(settings, active, constants.intensity, estimate, sample.u, sample.h, work)
        if settings.axes == 2:
            note_forced_rotation(settings, memory, x, h[m])
        for i in range(states):
            foreseen[i] = x[i]
        correct(settings, active, forgetful, observer.table, estimate, sample, work)
        memory.time += h[m]
        remember_drive(settings, memory, u[m])
        for axis in range(settings.axes):
            rows[m].nu[axis] = nu[axis]
            rows[m].s[axis] = variance[axis]
        multiply_rows(work.transition, delta, scratch)
        signal_values(settings, memory, memory.time, signals)
        add_forced(settings, memory, work.before, x, sample, response, follow, work)
        signal_values(settings, memory, memory.time, signals)
        watch_sensed(settings, x, u[m], follow, work)
        usable = 0
        for axis in range(settings.axes):
            if np.isfinite(z[m, axis]):
                usable += 1
                for j in range(delta.shape[0]):
                    w = jacobian[axis, j]
                    if w != 0.0:
                        for k in range(count):
                            signature[axis, k] -= w * delta[j, k]
            else:
                signature[axis, :] = 0.0
        if turning:
            if rate_row >= 0:
                for k in range(count):
                    turned[k] += delta[rate_row, k] * length
            if settings.open_loop == 0:  # else the angle is the integrated rate
                add_turn(settings, foreseen, rotation, rate, 1.0, follow)
        if usable > 0:
            for j in range(delta.shape[0]):
                for axis in range(settings.axes):
                    w = gain[j, axis]
                    for k in range(count):
                        delta[j, k] += w * signature[axis, k]
            if settings.fade > 1.0 and runs_riccati(settings, memory):
                recall(settings, active, constants, estimate, work.projected, delta)
        if settings.axes == 2:
            read_angle(settings, memory, x, h[m], rows[m])
        if turning and settings.open_loop == 0:
            add_turn(settings, x, memory.rotation, memory.rate, -1.0, follow)
        if (m + 1) * course.shape[0] >= (written + 1) * z.shape[0]:
            for k in range(count):
                course[written, k] = turned[k] / settings.angular_gain
            written += 1
        if usable == 0 or not weighed:
            continue
        share = min(1.0, level / max(memory.nis, 1e-12))
        for axis in range(settings.axes):
            weight = math.sqrt(share / variance[axis])
            row = settings.axes * m + axis
            for k in range(count):
                equations[row, k] = weight * signature[axis, k]
            equations[row, count] = weight * nu[axis]
