"""The observer's run over a block of samples with the signatures of effects it does not carry.

The signature of a coefficient is what the innovations would gain if it were 1: a small change of force or measurement
moves prediction and correction alike, δx⁻ = F δx + Γ, δν = −(H δx⁻ + η), δx⁺ = δx⁻ + L δν (Willsky & Jones, IEEE Trans.
Automatic Control 21(1), 1976, for jumps).  What the filter's own states and constants can take up is projected out by
the filter itself.  The sums N = Σ δν S⁻¹ δνᵀ and b = Σ δν S⁻¹ ν are the normal equations of all coefficients at once.
"""

import numpy as np

from estimator.kernel.block import advance
from estimator.kernel.compiled import compiled, generated
from estimator.kernel.flow import drive_at, part_of, taylor
from estimator.kernel.layout import Floats, Ints, Record
from estimator.kernel.observer import workspace
from estimator.kernel.signals import directions, line_values, signal_values

_effect_force = generated().effect_force
_effect_sense = generated().effect_sense

# Gauss–Legendre on [0, 1], three nodes: exact to degree 5.
_NODES = (0.11270166537925831, 0.5, 0.88729833462074169)
_WEIGHTS = (0.27777777777777778, 0.44444444444444444, 0.27777777777777778)


@compiled
def responses(settings: Record, c: Floats, h: float, a: Floats, b: Floats, out: Floats) -> Floats:
    """What a unit impulse on each axis at the nodes (and, last, at the start) leaves at the end: (4, states, axes)."""
    states = settings.states
    response = np.zeros((len(_NODES) + 1, states, settings.axes))
    rest = np.zeros((settings.axes, 1))
    for node in range(len(_NODES) + 1):
        left = 1.0 - _NODES[node] if node < len(_NODES) else 1.0
        for axis in range(settings.axes):
            out[:, 0] = 0.0
            out[2 * axis + 1, 0] = 1.0
            taylor(settings.model, c, rest, left * h, settings.order, 1, a, b, out)
            for i in range(states):
                response[node, i, axis] = out[i, 0]
    return response


@compiled
def add_forced(
    settings: Record,
    memory: Record,
    before: Floats,
    x: Floats,
    u: Floats,
    h: float,
    response: Floats,
    origin: int,
    work: tuple[Floats, ...],
    by_constants: Floats,
    delta: Floats,
) -> None:
    """Add to the states' rows of delta (n, coefficients) what the watched forces push over the interval that has ended.

    before: the states at its beginning; origin: index of the first watched coefficient among the constants.
    """
    states = settings.states
    a, b, out = work[:3]
    value, by_states, drive, signals = work[12], work[13], work[15], work[16]
    c = x[states:]
    watched = delta.shape[1]
    for i in range(states):
        out[i, 0] = before[i]
    at = 0.0
    for node in range(len(_NODES)):
        length = _NODES[node] - at
        taylor(settings.model, c, part_of(u, at, length), length * h, settings.order, 1, a, b, out)
        at = _NODES[node]
        drive_at(u, at, drive)
        line_values(settings, memory.time + (at - 1.0) * h, signals)
        directions(settings, out[:, 0], signals)
        by_constants[:] = 0.0
        for e in range(settings.effect_count, settings.effect_count + settings.candidate_count):
            number, first, signal = settings.effects[e]
            _effect_force(
                number, settings.model, c, out[:, 0], drive, signals, first, signal, value, by_states, by_constants
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
def watch_sensed(
    settings: Record,
    x: Floats,
    u: Floats,
    origin: int,
    work: tuple[Floats, ...],
    by_constants: Floats,
    signature: Floats,
) -> None:
    """signature (axes, coefficients) ← less what the watched effects add to the measurement at the interval's end."""
    states = settings.states
    value, by_states, drive, signals = work[12], work[13], work[15], work[16]
    c = x[states:]
    drive_at(u, 1.0, drive)
    by_constants[:] = 0.0
    for e in range(settings.effect_count, settings.effect_count + settings.candidate_count):
        number, first, signal = settings.effects[e]
        _effect_sense(
            number, settings.model, c, x[:states], drive, signals, first, signal, value, by_states, by_constants
        )
    if settings.watched_sense_delay >= 0:
        for axis in range(settings.axes):
            by_constants[axis, settings.watched_sense_delay + axis] -= x[2 * axis + 1]
    for axis in range(settings.axes):
        for k in range(signature.shape[1]):
            signature[axis, k] = -by_constants[axis, origin + k]


@compiled
def multiply_rows(g: Floats, delta: Floats, scratch: Floats) -> None:
    """First rows of delta ← g delta; delta (n, coefficients), g (rows, n)."""
    rows, n = g.shape
    scratch[:rows] = 0.0
    for i in range(rows):
        for j in range(n):
            w = g[i, j]
            for k in range(delta.shape[1]):
                scratch[i, k] += w * delta[j, k]
    for i in range(rows):
        for k in range(delta.shape[1]):
            delta[i, k] = scratch[i, k]


@compiled
def scan_block(
    settings_record: Record,
    active: Ints,
    walk: Floats,
    prior: Floats,
    spread: Floats,
    guess: Floats,
    table: Floats,
    x: Floats,
    p: Floats,
    c: Floats,
    memory_record: Record,
    z: Floats,
    u: Floats,
    h: Floats,
    temperature: Floats,
    rows: Record,
    delta: Floats,
    level: float,
    normal: Floats,
    score: Floats,
) -> None:
    """Observe n samples as `observe_block` does, and add their normal equations to normal (k, k) and score (k,).

    delta (states + active constants, k): sensitivity of the filter's estimates to the k watched coefficients, carried
    on.  Samples around an innovation larger than `level` times its variance count less, in proportion: a jump of the
    rate says nothing of an effect.
    """
    settings = settings_record[0]
    memory = memory_record[0]
    states = settings.states
    work = workspace(settings, p.shape[0], x.shape[0])
    nu = np.zeros(2)
    variance = np.zeros(2)
    watched = delta.shape[1]
    origin = x.shape[0] - states - watched
    by_constants = np.zeros((2, x.shape[0] - states))
    signature = np.zeros((2, watched))
    scratch = np.zeros((2 if states < 2 else states, watched))
    a, b, out, g, jacobian, gain, before, signals = (
        work[0], work[1], work[2], work[3], work[5], work[7], work[18], work[16],
    )  # fmt: skip
    response = responses(settings, x[states:], h[0], a, b, out)
    length = h[0]
    for m in range(z.shape[0]):
        if temperature.shape[0] > 0:
            memory.temperature = temperature[m]
        if h[m] != length:
            length = h[m]
            response = responses(settings, x[states:], length, a, b, out)
        advance(
            settings, active, walk, prior, spread, guess, table, x, p, c, memory, z[m], u[m], h[m],
            work, nu, variance, rows[m],
        )  # fmt: skip
        multiply_rows(g, delta, scratch)
        signal_values(settings, memory, memory.time, signals)
        add_forced(settings, memory, before, x, u[m], length, response, origin, work, by_constants, delta)
        signal_values(settings, memory, memory.time, signals)
        watch_sensed(settings, x, u[m], origin, work, by_constants, signature)
        usable = 0
        for axis in range(settings.axes):
            if np.isfinite(z[m, axis]):
                usable += 1
                for j in range(delta.shape[0]):
                    w = jacobian[axis, j]
                    if w != 0.0:
                        for k in range(watched):
                            signature[axis, k] -= w * delta[j, k]
            else:
                signature[axis, :] = 0.0
        if usable == 0:
            continue
        for j in range(delta.shape[0]):
            for axis in range(settings.axes):
                w = gain[j, axis]
                for k in range(watched):
                    delta[j, k] += w * signature[axis, k]
        share = min(1.0, level / max(memory.surprise, 1e-12))
        for axis in range(settings.axes):
            weight = share / variance[axis]
            for i in range(watched):
                w = weight * signature[axis, i]
                score[i] += w * nu[axis]
                for k in range(i, watched):
                    normal[i, k] += w * signature[axis, k]
    for i in range(watched):
        for k in range(i):
            normal[i, k] = normal[k, i]
