"""`estimator.kernel.scan` for the observer of 13 states without effects, whose covariances are in vector registers.

The measurements are taken in one after the other, as `estimator.kernel.plain` does, and the sensitivities follow each.
"""

import math

import numpy as np

from estimator.kernel.angle import note_forced_rotation, read_angle
from estimator.kernel.compiled import compiled
from estimator.kernel.controller import virtual_rate
from estimator.kernel.layout import RATE, Floats, Ints, Record
from estimator.kernel.observer import ATTENTION, remember_drive, workspace
from estimator.kernel.plain import CONSTANTS, SIZE, STATES, STEP, is_plain
from estimator.kernel.scan import Block, Signatures, add_forced, add_turn, following, responses, watch_sensed
from estimator.kernel.signals import advance_signals, signal_values
from estimator.kernel.structures import Arrays, Constants, Estimate, Sample

_predict, _unpacked, _restore = STEP.predict, STEP.unpacked, STEP.restore
_measure_x, _measure_y, _recall = STEP.measure_0, STEP.measure_1, STEP.recall
_FLOW: int = STEP._FLOW
_Y: int = STEP._Y
_OFFSETS = 2  # constants that move nothing


@compiled
def scans_plainly(settings_record: Record, active: Ints, x: Floats) -> bool:
    """Whether `scan_plain_block` does what the settings ask for; x without the watched coefficients."""
    settings = settings_record[0]
    bare: bool = settings.effect_count == 0
    signals = settings.signal_count
    settings.signal_count = 0  # those are the watched effects' own
    plain: bool = is_plain(settings, active, x)
    settings.signal_count = signals
    return plain and bare


@compiled
def flow_delta(work: Floats, delta: Floats, scratch: Floats) -> None:
    """States' rows of delta (13, k) ← F delta with the flow in work; scratch (4, k)."""
    watched = delta.shape[1]
    for i in range(STATES):
        f = _FLOW * i + 1
        for k in range(watched):
            scratch[i, k] = 0.0
        for j in range(STATES):
            w = work[f + j]
            for k in range(watched):
                scratch[i, k] += w * delta[j, k]
        for j in range(CONSTANTS - _OFFSETS):
            w = work[f + STATES + j]
            for k in range(watched):
                scratch[i, k] += w * delta[STATES + _OFFSETS + j, k]
    for i in range(STATES):
        for k in range(watched):
            delta[i, k] = scratch[i, k]


@compiled
def take_along(axis: int, column: int, noise: float, work: Floats, seen: Floats, delta: Floats) -> None:
    """delta ← delta + K seen, for the measurement that was just taken in.

    seen (k,): what its innovation would gain.  The gain is y/√S with y = Ph/√S in work; h'y = (S − R)/√S gives √S.
    """
    along = work[_Y + column]
    if axis >= 0:
        along += work[_Y + 2 * axis]
    root = 0.5 * (along + math.sqrt(along * along + 4.0 * noise))
    for j in range(SIZE):
        w = work[_Y + j] / root
        for k in range(delta.shape[1]):
            delta[j, k] += w * seen[k]


@compiled
def scan_plain_block(observer: Arrays, block: Block, signatures: Signatures) -> None:
    """As `estimator.kernel.scan.scan_block`; delta (13, k)."""
    settings = observer.settings[0]
    memory = observer.memory[0]
    constants = Constants(observer.intensity, observer.prior, observer.spread, observer.initial)
    prior, spread, initial = constants.prior, constants.spread, constants.initial
    x = observer.x
    z, u, h, temperature, rows = block
    level, equations, turned, course = signatures.level, signatures.equations, signatures.turned, signatures.course
    delta = signatures.delta
    count = delta.shape[1]
    generic = workspace(settings, SIZE, x.shape[0])
    term, out, signals = generic.flow.term, generic.flow.out, generic.flow.push.signals
    flat_x, flat_p, flat_c, work = _unpacked(x[:SIZE], observer.p, observer.c, memory, True)
    estimate = Estimate(flat_x, flat_p, flat_c, memory)
    rate_row = STATES + RATE
    follow = following(signatures, SIZE - STATES, rate_row, x.shape[0] - STATES)
    signature = follow.signature
    scratch = np.zeros((STATES, count))
    before = np.zeros(STATES)
    foreseen = np.zeros(STATES)
    weighed = equations.shape[0] > 0
    response = responses(settings, x[STATES:], h[0], term, out)
    length = h[0]
    written = 0
    for m in range(z.shape[0]):
        if temperature.shape[0] > 0:
            memory.temperature = temperature[m]
        if h[m] != length:
            length = h[m]
            response = responses(settings, x[STATES:], length, term, out)
        driven = u[m, 0, 0] != 0.0 or u[m, 1, 0] != 0.0
        memory.virtual_applied = virtual_rate(settings, memory.time) if settings.control == 1 and driven else 0.0
        turning = memory.started == 1
        rotation = memory.rotation
        rate = memory.rate
        for i in range(STATES):
            before[i] = flat_x[i]
        for i in range(STATES, SIZE):
            x[i] = flat_x[i]
        sample = Sample(z[m], u[m], h[m])
        _predict(settings, constants.intensity, estimate, sample.u, sample.h, work)
        if settings.signal_count > 0:
            advance_signals(settings, memory, x[STATES:], u[m], h[m])
        note_forced_rotation(settings, memory, flat_x, h[m])
        for i in range(STATES):
            foreseen[i] = flat_x[i]
            x[i] = flat_x[i]
        flow_delta(work, delta, scratch)
        signal_values(settings, memory, memory.time + h[m], signals)
        memory.time += h[m]
        remember_drive(settings, memory, u[m])
        add_forced(settings, memory, before, x, sample, response, follow, generic)
        signal_values(settings, memory, memory.time, signals)
        watch_sensed(settings, x, u[m], follow, generic)
        if turning:
            for k in range(count):
                turned[k] += delta[rate_row, k] * length
            if settings.open_loop == 0:  # else the angle is the integrated rate
                add_turn(settings, foreseen, rotation, rate, 1.0, follow)
        usable = 0
        for axis in range(2):
            place = 2 * axis
            column = STATES + axis
            rows[m].nu[axis] = 0.0
            rows[m].s[axis] = settings.noise[axis] + flat_c[17 * place] + 2.0 * flat_c[16 * place + column]
            rows[m].s[axis] += flat_c[17 * column]
            if np.isfinite(z[m, axis]):
                usable += 1
                rows[m].nu[axis] = z[m, axis] - (flat_x[place] + flat_x[column])
            if weighed:
                share = 1.0 / math.sqrt(rows[m].s[axis])
                row = 2 * m + axis
                if np.isfinite(z[m, axis]):
                    for k in range(count):
                        equations[row, k] = share * (signature[axis, k] - delta[place, k] - delta[column, k])
                equations[row, count] = share * rows[m].nu[axis]
        nis = 0.0
        for axis in range(2):
            if np.isfinite(z[m, axis]):
                place = 2 * axis
                column = STATES + axis
                innovation = z[m, axis] - (flat_x[place] + flat_x[column])
                for k in range(count):
                    signature[axis, k] -= delta[place, k] + delta[column, k]
                if axis == 0:
                    white, _ = _measure_x(innovation, settings.noise[0], estimate, work)
                else:
                    white, _ = _measure_y(innovation, settings.noise[1], estimate, work)
                nis += 0.5 * white * white
                take_along(axis, column, settings.noise[axis], work, signature[axis], delta)
        if usable > 0:
            memory.nis += (nis - memory.nis) * ATTENTION
            if weighed and memory.nis > level:
                share = math.sqrt(level / memory.nis)
                for row in range(2 * m, 2 * m + 2):
                    for k in range(count + 1):
                        equations[row, k] *= share
        if usable > 0 and settings.fade > 1.0:
            memory.cursor = (memory.cursor + 1) % CONSTANTS
            for turn in range(CONSTANTS + 1):
                index = memory.cursor if turn == 0 else turn - 1
                column = STATES + index
                noise = prior[index]
                if turn > 0:
                    variance = flat_p[17 * column]
                    wide = spread[index] > 0.0 and variance > spread[index]
                    noise = variance * spread[index] / (variance - spread[index]) if wide else 0.0
                if noise > 0.0:
                    pulled = initial[index] - flat_x[column]
                    _recall(index, pulled, noise, estimate, work)
                    for k in range(count):
                        signature[0, k] = -delta[column, k]
                    take_along(-1, column, noise, work, signature[0], delta)
        read_angle(settings, memory, flat_x, h[m], rows[m])
        if turning and settings.open_loop == 0:
            add_turn(settings, flat_x, memory.rotation, memory.rate, -1.0, follow)
        if (m + 1) * course.shape[0] >= (written + 1) * z.shape[0]:
            for k in range(count):
                course[written, k] = turned[k] / settings.angular_gain
            written += 1
    _restore(flat_x, flat_p, flat_c, work, x, observer.p, observer.c, memory)
