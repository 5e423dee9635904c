"""A block of samples in, a block of estimates out; and one sample in, one drive out."""

import math

import numpy as np

from estimator.kernel.angle import note_forced_rotation, read_angle
from estimator.kernel.angle_error import note_gradient, refer_angle
from estimator.kernel.compiled import compiled, inlined
from estimator.kernel.controller import advance_queue, command, virtual_rate
from estimator.kernel.layout import MAX_AXES, Floats, Ints, Record
from estimator.kernel.observer import correct, narrowed, predict, remember_drive, widened, workspace
from estimator.kernel.plain import STEP, is_plain
from estimator.kernel.structures import Constants, Estimate, Sample, Workspace

_advance_plain, _unpacked, _restore = STEP.advance, STEP.unpacked, STEP.restore


@inlined
def advance(
    settings: Record,
    active: Ints,
    constants: Constants,
    table: Floats,
    estimate: Estimate,
    sample: Sample,
    work: Workspace,
    row: Record,
) -> None:
    """One sample: predict with the drive that acted, note how it turned the pattern, correct with what was measured,
    fill the output row.
    """
    x, memory, h = estimate.x, estimate.memory, sample.h
    predict(settings, active, constants.intensity, estimate, sample.u, h, work)
    if settings.axes == 2:
        note_forced_rotation(settings, memory, x, h)
        note_gradient(settings, memory, x)
    correct(settings, active, constants, table, estimate, sample, work)
    memory.time += h
    remember_drive(settings, memory, sample.u)
    nu, variance = work.innovation, work.variance
    for axis in range(settings.axes):
        row.nu[axis] = nu[axis]
        row.s[axis] = variance[axis]
    if settings.axes == 2:
        read_angle(settings, memory, x, h, row)
        if refer_angle(settings, memory):
            memory.angle_variance = 0.0
            memory.angle_cross[:] = 0.0
        row.angle_variance = memory.angle_variance / settings.angular_gain**2


@compiled
def observe_block(
    settings_record: Record,
    active: Ints,
    intensity: Floats,
    prior: Floats,
    spread: Floats,
    initial: Floats,
    table: Floats,
    x: Floats,
    p: Floats,
    c: Floats,
    memory_record: Record,
    z: Floats,
    u: Floats,
    h: Floats,
    temperature: Floats,
    truth: Floats,
    rows: Record,
    states_out: Floats,
    deviations_out: Floats,
    every: int,
) -> int:
    """Run the observer over n samples: z (n, axes), u (n, axes, degree + 1) the drive over the interval that ends at
    each, h (n,), temperature (n,) or (0,).

    rows (n,) of OUTPUT; every `every` samples the state vector goes to states_out and its standard deviations to
    deviations_out.  With truth of n rows (else 0 rows) the state vector is replaced by the truth before each step, so
    that p follows the posterior Cramér–Rao recursion along the true trajectory.  Returns the number of state rows
    written.
    """
    settings = settings_record[0]
    memory = memory_record[0]
    constants = Constants(intensity, prior, spread, initial)
    n_full = x.shape[0]
    work = workspace(settings, p.shape[0], n_full)
    plain = truth.shape[0] == 0 and is_plain(settings, active, x)
    flat_x, flat_p, flat_c, own = _unpacked(x, p, c, memory, plain)
    wide_p = widened(p)
    wide_c = widened(c) if settings.two_covariances == 1 else wide_p
    flat = Estimate(flat_x, flat_p, flat_c, memory)
    wide = Estimate(x, wide_p, wide_c, memory)
    actual = c if plain else wide_c
    written = 0
    for m in range(z.shape[0]):
        if truth.shape[0] > 0:
            x[:] = truth[m]
        if temperature.shape[0] > 0:
            memory.temperature = temperature[m]
        if settings.axes == 2:
            driven = u[m, 0, 0] != 0.0 or u[m, 1, 0] != 0.0
            memory.virtual_applied = virtual_rate(settings, memory.time) if settings.control == 1 and driven else 0.0
        sample = Sample(z[m], u[m], h[m])
        if plain:
            _advance_plain(settings, constants, flat, sample, own, rows[m])
        else:
            advance(settings, active, constants, table, wide, sample, work, rows[m])
        if m % every == every - 1:
            if plain:
                _restore(flat_x, flat_p, flat_c, own, x, p, c, memory)
            for i in range(n_full):
                states_out[written, i] = x[i]
                deviations_out[written, i] = 0.0
            for i in range(settings.states):
                deviations_out[written, i] = math.sqrt(actual[i, i])
            for i in range(active.shape[0]):
                j = settings.states + i
                deviations_out[written, settings.states + active[i]] = math.sqrt(actual[j, j])
            written += 1
    if plain:
        _restore(flat_x, flat_p, flat_c, own, x, p, c, memory)
    else:
        narrowed(wide_p, p)
        if settings.two_covariances == 1:
            narrowed(wide_c, c)
    return written


@compiled
def tick(
    settings_record: Record,
    active: Ints,
    intensity: Floats,
    prior: Floats,
    spread: Floats,
    initial: Floats,
    table: Floats,
    x: Floats,
    p: Floats,
    c: Floats,
    memory_record: Record,
    vx: float,
    vy: float,
    ux: float,
    uy: float,
    rows: Record,
    codes: Floats,
) -> None:
    """One sample of the closed loop: sense codes (NaN: lost) and echoed drive codes → codes (2,) to send, rows[0]
    filled.
    """
    settings = settings_record[0]
    memory = memory_record[0]
    constants = Constants(intensity, prior, spread, initial)
    work = workspace(settings, p.shape[0], x.shape[0])
    drive = np.zeros((2, 1))
    drive[0, 0] = ux * settings.quantum
    drive[1, 0] = uy * settings.quantum
    z = np.zeros(MAX_AXES)
    z[0] = vx * settings.sense_scale[0]
    z[1] = vy * settings.sense_scale[1]
    sample = Sample(z, drive, settings.h)
    advance_queue(settings, memory, drive[:, 0])
    if is_plain(settings, active, x):
        flat_x, flat_p, flat_c, own = _unpacked(x, p, c, memory, True)
        _advance_plain(settings, constants, Estimate(flat_x, flat_p, flat_c, memory), sample, own, rows[0])
        _restore(flat_x, flat_p, flat_c, own, x, p, c, memory)
    else:
        advance(settings, active, constants, table, Estimate(x, p, c, memory), sample, work, rows[0])
    command(settings, memory, x, work, codes)
