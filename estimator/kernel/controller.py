"""The control law (9) and what it needs to work through a sampled, delayed drive.

The force computed from sample m acts over the interval that begins at m + latency.  The state is predicted exactly
through the drives already queued, then half a sample ahead with the *target* flow (stiffness k and rotation Ω̂ + Ωv),
because a held force acts on average in the middle of its interval; and all of it is divided by what the hold leaves of
a sinusoid.
"""

import numpy as np

from estimator.kernel.compiled import compiled
from estimator.kernel.flow import effect_forces, flow
from estimator.kernel.layout import DXX, DXY, DYY, KXX, KXY, KYY, MAX_AXES, RATE, Floats, Record
from estimator.kernel.observer import shift_drives
from estimator.kernel.pattern import pattern
from estimator.kernel.signals import line_values, signal_values
from estimator.kernel.structures import Interval, Push, Workspace
from estimator.kernel.taylor import taylor

_INVERSIONS = 5


@compiled
def dither_force(memory: Record, amplitude: float) -> float:
    """Next value of a two-level pseudo-random force, ± amplitude (xorshift64)."""
    state = memory.dither
    state ^= state << np.uint64(13)
    state ^= state >> np.uint64(7)
    state ^= state << np.uint64(17)
    memory.dither = state
    return amplitude if state & np.uint64(1 << 32) else -amplitude


@compiled
def virtual_rate(settings: Record, time: float) -> float:
    """Virtual rotation asked for in the interval that begins at `time`.

    With reversals it begins halfway between two of them, so that the pattern goes as far to one side as to the other.
    """
    rate: float = settings.virtual_rate
    if settings.reversal > 0.0:
        # Half a sample on: which side of a reversal a sample is on must not hang on the rounding of a sum.
        turn = np.floor((time + 0.5 * settings.h) / settings.reversal + 0.5)
        if turn - 2.0 * np.floor(0.5 * turn) > 0.5:
            return -rate
    return rate


@compiled
def acting(settings: Record, memory: Record) -> float:
    """Virtual rotation of the drive computed from the newest sample, which acts `latency` samples on."""
    asked: float = virtual_rate(settings, memory.time + settings.latency * settings.h)
    return asked


@compiled
def holds(settings: Record, memory: Record, s: Floats, rate: float, w: float, fastest: float) -> tuple[float, float]:
    """(damping along the velocity, force across the position) per unit of either, for state s at rotation w, neither
    acting faster than `fastest`.
    """
    k = settings.stiffness
    root = np.sqrt(k)
    _, energy, momentum = pattern(s, k, w, rate)
    swing = 1.0 + settings.modulation * np.sin(settings.modulation_rate * memory.time)
    target = settings.energy * (swing * swing)
    # Amplitude: damping along the velocity, never more than twice the gain however large the error (start from rest).
    error = min(max((target - energy) / settings.energy, -2.0), 2.0)
    hold = min(settings.energy_gain * root, fastest) * error
    # Quadrature: a force across the position turns the ellipse back into a line without precession to first order.
    ratio = min(max(root * momentum / max(energy, 1e-3 * target), -1.0), 1.0)
    square = -min(settings.quadrature_gain * root, fastest) * root * ratio
    return hold, square


@compiled
def control_law(settings: Record, memory: Record, s: Floats, c: Floats, out: Floats) -> None:
    """out ← (9) plus energy hold, quadrature hold and virtual rotation, for state s and constants c.

    (9) prints positions where its damping terms need velocities; implemented with velocities.
    """
    x, vx, y, vy = s[0], s[1], s[2], s[3]
    k = settings.stiffness
    virtual = acting(settings, memory)
    w = c[RATE] + virtual
    hold, square = holds(settings, memory, s, c[RATE], w, np.inf)
    out[0] = (
        c[DXX] * vx + c[DXY] * vy + c[KXX] * x + c[KXY] * y - k * x
        + hold * (vx - w * y) - square * y + 2.0 * virtual * vy
    )  # fmt: skip
    out[1] = (
        c[DXY] * vx + c[DYY] * vy + c[KXY] * x + c[KYY] * y - k * y
        + hold * (vy + w * x) + square * x - 2.0 * virtual * vx
    )  # fmt: skip


@compiled
def undo_effects(settings: Record, c: Floats, s: Floats, push: Push, force: Floats) -> None:
    """Change the force so that with the effects' own it is what it was: what depends on the state is cancelled, what
    depends on the drive (its gain, its misalignment) inverted by iteration, which converges as the gain error's powers,
    on a drive that acts the wrong way round as those of what it is beside −1.
    """
    extra, drive = push.force, push.drive
    wanted = force.copy()
    slope = np.zeros(MAX_AXES)  # of what acts on an axis by its drive, times two
    for side in (1.0, -1.0):
        drive[:] = side
        effect_forces(settings, c, s, push)
        slope += 1.0 + side * extra
    for _ in range(_INVERSIONS):
        drive[:] = force
        effect_forces(settings, c, s, push)
        for axis in range(2):
            if slope[axis] < 0.0:
                force[axis] += force[axis] + extra[axis] - wanted[axis]
            else:
                force[axis] = wanted[axis] - extra[axis]


@compiled
def steer(settings: Record, memory: Record, s: Floats, c: Floats, ahead: float, work: Workspace) -> Floats:
    """Force (2,) wanted from a drive that begins to be held where the state is s, and acts `ahead` later on average."""
    out = work.flow.out
    target = c.copy()
    target[RATE] = c[RATE] + acting(settings, memory)
    target[KXX] = settings.stiffness
    target[KYY] = settings.stiffness
    target[KXY] = 0.0
    target[DXX] = 0.0
    target[DYY] = 0.0
    target[DXY] = 0.0
    for i in range(settings.states):
        out[i, 0] = s[i]
    taylor(settings.model, target, np.zeros((2, 1)), ahead, settings.order, 1, work.flow.term, out)
    force = np.zeros(MAX_AXES)
    control_law(settings, memory, out[:, 0].copy(), c, force)
    if settings.pushes > 0:
        undo_effects(settings, c, out[:, 0].copy(), work.flow.push, force)
    return force


@compiled
def command(settings: Record, memory: Record, x: Floats, work: Workspace, out: Floats) -> None:
    """Drive codes (out, 2) for the interval `latency` samples ahead, and their place in the queue.

    x is the state vector after the update with the newest sample.  The queue holds what was commanded for the intervals
    that begin at this sample and later.  A drive that is late by more than was declared is asked for that much earlier.
    """
    ahead, signals = work.flow.out, work.flow.push.signals
    states = settings.states
    latency = settings.latency
    h = settings.h
    s = x[:states].copy()
    c = x[states:].copy()
    u = np.zeros((2, 1))
    force = np.zeros(MAX_AXES)
    virtual = 0.0
    if settings.control == 1:
        past = memory.past.copy()
        alone = np.int64(1)  # not a literal, for which the flow would be compiled once more
        signal_values(settings, memory, memory.time, signals)
        for j in range(latency):
            u[0, 0] = memory.queue[j, 0]
            u[1, 0] = memory.queue[j, 1]
            flow(settings, Interval(memory.time + j * h, h, u), past, c, s, alone, work.flow)
            for i in range(states):
                s[i] = ahead[i, 0]
            if settings.drive_delay >= 0:
                shift_drives(past, u)
        line_values(settings, memory.time + (latency + 0.5) * h, signals)
        if settings.drive_delay >= 0:
            for axis in range(2):
                late = c[settings.drive_delay + axis]
                force[axis] = steer(settings, memory, s, c, 0.5 * h + late, work)[axis]
        else:
            force[:] = steer(settings, memory, s, c, 0.5 * h, work)
        virtual = acting(settings, memory)
    for axis in range(2):
        value = force[axis] / settings.hold
        if settings.control == 1 and settings.dither > 0.0:
            value += dither_force(memory, settings.dither)
        if not np.isfinite(value):
            value = 0.0
        value = min(max(value, -settings.force_limit), settings.force_limit)
        code = np.rint(value / settings.quantum)
        out[axis] = code
        memory.queue[latency, axis] = code * settings.quantum
    memory.queue[latency, 2] = virtual


@compiled
def advance_queue(settings: Record, memory: Record, u: Floats) -> None:
    """Drop the command whose interval has ended and note which virtual rotation the board really applied.

    u (2,) is the echoed drive.  A zero echo where something was commanded is a board in SAFE; anything else that
    differs is a drive held over a late answer, whose virtual rotation stays what it was.
    """
    expected = (
        abs(u[0] - memory.queue[0, 0]) < 0.5 * settings.quantum
        and abs(u[1] - memory.queue[0, 1]) < 0.5 * settings.quantum
    )
    if expected:
        memory.virtual_applied = memory.queue[0, 2]
    elif u[0] == 0.0 and u[1] == 0.0:
        memory.virtual_applied = 0.0
    for j in range(settings.latency):
        for i in range(3):
            memory.queue[j, i] = memory.queue[j + 1, i]
