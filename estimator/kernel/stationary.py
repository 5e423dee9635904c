"""The Riccati recursion along the nominal orbit, its gains gathered by pattern angle and vibration phase."""

import math
from typing import NamedTuple

import numpy as np

from estimator.kernel.compiled import compiled
from estimator.kernel.layout import DXX, DXY, DYY, KXX, KXY, KYY, MAX_AXES, Floats
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
from estimator.kernel.structures import Arrays, Sample


class Course(NamedTuple):
    """How the orbit is gone along: rotation of its pattern, samples h apart, so many of them to settle, so many that
    count.
    """

    rotation: float
    h: float
    settle: int
    samples: int


@compiled
def orbit(t: float, rotation: float, s: Floats) -> None:
    """Motion (x, ẋ, y, ẏ) at scaled time t of the ideal controlled device: unit amplitude, pattern turned at −rotation.

    The solution of ẍ + x = 2W ẏ, ÿ + y = −2W ẋ that is a straight line in the frame that turns with it.
    """
    fast = math.sqrt(1.0 + rotation * rotation)
    along, across = math.cos(rotation * t), -math.sin(rotation * t)
    r, v = math.cos(fast * t), -fast * math.sin(fast * t)
    s[0] = along * r
    s[2] = across * r
    s[1] = along * v + rotation * s[2]
    s[3] = across * v - rotation * s[0]


@compiled
def holding_force(constants: Floats, s: Floats, rotation: float, u: Floats) -> None:
    """The force (axes, 1) that keeps a device with these constants on the orbit: (9) and the virtual rotation."""
    kxx, kyy, kxy = constants[KXX], constants[KYY], constants[KXY]
    dxx, dyy, dxy = constants[DXX], constants[DYY], constants[DXY]
    u[0, 0] = (kxx - 1.0) * s[0] + kxy * s[2] + dxx * s[1] + dxy * s[3] + 2.0 * rotation * s[3]
    u[1, 0] = (kyy - 1.0) * s[2] + kxy * s[0] + dyy * s[3] + dxy * s[1] - 2.0 * rotation * s[1]


@compiled
def gather_gains(arrays: Arrays, course: Course, total: Floats, weight: Floats) -> None:
    """Sum of the gains (angles, phases, n, channels) and their number (angles, phases) into total and weight.

    The device has the constants in arrays.x and is held on the orbit of the ideal controlled one, whose pattern
    precesses: the error system is the device's own, only its motion is the ideal one.  arrays.p goes on; the samples to
    settle only bring it to its periodic state.
    """
    settings = arrays.settings[0]
    memory = arrays.memory[0]
    active, p, prior = arrays.active, arrays.p, arrays.prior
    rotation, h, settle, samples = course
    states = settings.states
    n = p.shape[0]
    constants = arrays.x[states:]
    x = np.zeros(states + constants.shape[0])
    x[states:] = constants
    work = workspace(settings, n, x.shape[0])
    gain, assumed = work.gain, work.assumed
    u = np.zeros((2, 1))
    sample = Sample(np.zeros(MAX_AXES), u, h)
    s = x[:states]
    middle = np.zeros(states)
    angles, phases = weight.shape
    cursor = 0
    for m in range(settle + samples):
        orbit((m + 0.5) * h, rotation, middle)
        holding_force(constants, middle, rotation, u)
        orbit(m * h, rotation, s)
        predict_state(settings, active, memory, x, u, h, work)
        orbit((m + 1) * h, rotation, s)
        propagate(p, work.transition, work.rows, settings.fade)
        add_process_noise(p, settings, h, s, active, arrays.intensity, work.jump)
        predict_measurement(settings, active, memory, x, sample, work)
        for axis in range(settings.axes):
            assumed[axis] = work.noise[axis] + settings.ignored[axis]
        kalman_gain(p, work.jacobian, assumed, settings.axes, work.innovation, gain)
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
        joseph(p, work.jacobian, assumed, settings.axes, gain, work.projected)
        if active.shape[0] > 0:
            cursor = (cursor + 1) % active.shape[0]
            row = states + cursor
            if prior[cursor] > 0.0:
                rank_one(p, row, p[:, row] / (p[row, row] + prior[cursor]), prior[cursor], work.projected[0])
