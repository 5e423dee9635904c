"""The observer's own model in closed loop with itself: what an experiment's record would look like."""

import numpy as np

from estimator.kernel.block import tick
from estimator.kernel.compiled import compiled
from estimator.kernel.flow import flow
from estimator.kernel.layout import RATE, Floats, Ints, Record
from estimator.kernel.observer import workspace


@compiled
def experiment_block(
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
    truth: Floats,
    rates: Floats,
    stiffness: Floats,
    noise: Floats,
    rows: Record,
    sensed: Floats,
    drive: Floats,
) -> None:
    """n samples of the loop: truth (states + constants,) moves under the drive the observer asks for.

    rates (n,) is the rotation rate at each sample, stiffness (n,) the controller's target, noise (n, 2) is added to
    what is sensed; sensed and drive (n, 2) receive the record, drive[m] acting over the interval that ends at m.
    """
    settings = settings_record[0]
    states = settings.states
    work = workspace(settings, p.shape[0], x.shape[0])
    a, b, out = work[:3]
    push = work[12:17]
    codes = np.zeros(2)
    queue = np.zeros((settings.latency + 1, 2))
    u = np.zeros((2, 1))
    past = memory_record[0].past.copy()
    s = truth[:states].copy()
    constants = truth[states:].copy()
    for m in range(rates.shape[0]):
        jump = rates[m] - constants[RATE]
        constants[RATE] = rates[m]
        s[1] += jump * s[2]
        s[3] -= jump * s[0]
        u[0, 0] = queue[0, 0]
        u[1, 0] = queue[0, 1]
        flow(settings, 0.0, past, constants, s, u, settings.h, 1, a, b, out, push)
        for i in range(states):
            s[i] = out[i, 0]
        for axis in range(2):
            sensed[m, axis] = s[2 * axis] + constants[axis] + noise[m, axis]
            drive[m, axis] = u[axis, 0]
        settings_record[0].stiffness = stiffness[m]
        tick(
            settings_record, active, walk, prior, spread, guess, table, x, p, c, memory_record,
            sensed[m, 0] / settings.sense_scale[0], sensed[m, 1] / settings.sense_scale[1],
            u[0, 0] / settings.quantum, u[1, 0] / settings.quantum, rows, codes,
        )  # fmt: skip
        for j in range(settings.latency):
            queue[j] = queue[j + 1]
        queue[settings.latency, 0] = codes[0] * settings.quantum
        queue[settings.latency, 1] = codes[1] * settings.quantum
