"""The observer's own model in closed loop with itself: what an experiment's record would look like."""

from typing import NamedTuple

import numpy as np

from estimator.kernel.block import tick
from estimator.kernel.compiled import compiled
from estimator.kernel.flow import flow
from estimator.kernel.layout import MAX_AXES, RATE, Floats
from estimator.kernel.observer import workspace
from estimator.kernel.structures import Arrays, Interval


class Plan(NamedTuple):
    """What an experiment does: rotation rate and the controller's target stiffness (n,) at each sample, noise (n, 2)
    added to what is sensed.
    """

    rates: Floats
    stiffness: Floats
    noise: Floats


@compiled
def experiment_block(observer: Arrays, truth: Floats, plan: Plan, sensed: Floats, drive: Floats) -> None:
    """n samples of the loop: truth (states + constants,) moves under the drive the observer asks for.

    sensed and drive (n, 2) receive the record, drive[m] acting over the interval that ends at m.
    """
    settings = observer.settings[0]
    rates, stiffness, noise = plan
    states = settings.states
    work = workspace(settings, observer.p.shape[0], observer.x.shape[0])
    out = work.flow.out
    codes = np.zeros(MAX_AXES)
    queue = np.zeros((settings.latency + 1, 2))
    u = np.zeros((2, 1))
    past = observer.memory[0].past.copy()
    alone = np.int64(1)  # not a literal, for which the flow would be compiled once more
    s = truth[:states].copy()
    constants = truth[states:].copy()
    for m in range(rates.shape[0]):
        jump = rates[m] - constants[RATE]
        constants[RATE] = rates[m]
        s[1] += jump * s[2]
        s[3] -= jump * s[0]
        u[0, 0] = queue[0, 0]
        u[1, 0] = queue[0, 1]
        flow(settings, Interval(0.0, settings.h, u), past, constants, s, alone, work.flow)
        for i in range(states):
            s[i] = out[i, 0]
        for axis in range(2):
            sensed[m, axis] = s[2 * axis + settings.sensed[axis]] + constants[axis] + noise[m, axis]
            drive[m, axis] = u[axis, 0]
        settings.stiffness = stiffness[m]
        tick(
            observer.settings, observer.active, observer.intensity, observer.prior, observer.spread, observer.initial,
            observer.table, observer.x, observer.p, observer.c, observer.memory,
            sensed[m, 0] / settings.sense_scale[0], sensed[m, 1] / settings.sense_scale[1],
            u[0, 0] / settings.quantum, u[1, 0] / settings.quantum, observer.rows, codes,
        )  # fmt: skip
        for j in range(settings.latency):
            queue[j] = queue[j + 1]
        queue[settings.latency, 0] = codes[0] * settings.quantum
        queue[settings.latency, 1] = codes[1] * settings.quantum
