"""The Riccati recursion along the nominal orbit, its gains gathered by pattern angle and vibration phase."""

import math

import numpy as np

from estimator.kernel.compiled import compiled
from estimator.kernel.layout import KXX, KYY, RATE, Floats, Ints, Record
from estimator.kernel.observer import (
    add_process_noise,
    joseph,
    kalman_gain,
    predict_measurement,
    predict_state,
    propagate,
    rank_one,
    workspace,
)
from estimator.kernel.pattern import phase_and_angle


@compiled
def gather_gains(
    settings_record: Record,
    memory_record: Record,
    active: Ints,
    walk: Floats,
    prior: Floats,
    p: Floats,
    rotation: float,
    h: float,
    settle: int,
    samples: int,
    total: Floats,
    weight: Floats,
) -> None:
    """Sum of the gains (angles, phases, n, channels) and their number (angles, phases) into total and weight.

    The orbit is the controlled device's: an isotropic oscillator of unit stiffness and amplitude whose pattern
    precesses at `rotation`; the first `settle` samples only bring the covariance to its periodic state.
    """
    settings = settings_record[0]
    memory = memory_record[0]
    states = settings.states
    n = p.shape[0]
    x = np.zeros(states + settings.sense_constants + settings.flow_constants)
    work = workspace(settings, n, x.shape[0])
    g, scratch, jacobian, gain, ph, kick, noise = work[3], work[4], work[5], work[7], work[8], work[9], work[11]
    assumed = work[17]
    nu = np.zeros(2)
    z = np.zeros(2)
    u = np.zeros((2, 1))
    angles, phases = weight.shape
    x[0] = 1.0
    x[states + RATE] = rotation
    x[states + KXX] = 1.0
    x[states + KYY] = 1.0
    cursor = 0
    for m in range(settle + samples):
        predict_state(settings, active, memory, x, u, h, work)
        s = x[:states]
        propagate(p, g, scratch, settings.fade)
        add_process_noise(p, settings, h, s, active, walk, kick)
        predict_measurement(settings, active, memory, x, z, u, h, work, nu, noise)
        for axis in range(settings.axes):
            assumed[axis] = noise[axis] + settings.ignored[axis]
        kalman_gain(p, jacobian, assumed, settings.axes, nu, gain)
        if m >= settle:
            theta, phase = phase_and_angle(s, 1.0)
            cell = math.floor((theta + 0.5 * math.pi) / math.pi * angles + 0.5)
            column = math.floor((phase + math.pi) / (2.0 * math.pi) * phases + 0.5)
            if cell >= angles:
                cell -= angles
                column += phases // 2
            column %= phases
            weight[cell, column] += 1.0
            for i in range(n):
                for a in range(settings.axes):
                    total[cell, column, i, a] += gain[i, a]
        joseph(p, jacobian, assumed, settings.axes, gain, ph)
        if active.shape[0] > 0:
            cursor = (cursor + 1) % active.shape[0]
            row = states + cursor
            if prior[cursor] > 0.0:
                rank_one(p, row, p[:, row] / (p[row, row] + prior[cursor]), prior[cursor], ph[0])
