"""Records of oscillators with a force that no model declares, by SciPy's integrator."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from estimator.hold import drive_polynomials
from estimator.record import Record
from estimator.settings import Device, ObserverSettings, ProcessNoise, Spread
from estimator.trace.problem import Problem

Floats = NDArray[np.float64]
Force = Callable[[Floats, Floats], Floats]

OMEGA, LENGTH, GAIN = 2.0 * np.pi * 200.0, 1e-4, 1000.0
STIFFNESS = (OMEGA**2 * 1.01, OMEGA**2 * 0.99, OMEGA**2 * 0.005)
DAMPING = (OMEGA / 600.0, OMEGA / 500.0, OMEGA / 9000.0)
RATE = 0.9
A_FORCE = LENGTH * OMEGA**2
OFFSET = (3e-3, -2e-3)


@dataclass(frozen=True)
class Simulated:
    """position, velocity, force (n, axes) SI, and the problem that tracing is asked."""

    position: Floats
    velocity: Floats
    force: Floats
    problem: Problem


def simulated(force: Force, *, axes: int, samples: int, noise: float, seed: int = 1) -> Simulated:
    """force(q, v) per mass in units of k A with q in amplitudes and v in ωA, both (axes,); noise in amplitudes.

    Driven beside the resonance, so that the vibration's amplitude, and in a plane its direction, move.
    """
    rate_Hz = 4000.0
    t = np.arange(samples) / rate_Hz

    def drive(time: Floats) -> Floats:
        x = 4e-3 * np.cos(OMEGA * 1.004 * time) + 2e-3 * np.cos(OMEGA * 0.9973 * time + 1.0)
        y = 4e-3 * np.sin(OMEGA * 1.0013 * time + 0.4) + 2e-3 * np.cos(OMEGA * 0.994 * time)
        return np.asarray(A_FORCE * np.array([x, y])[:axes])

    kxx, kyy, kxy = STIFFNESS
    dxx, dyy, dxy = DAMPING
    stiffness = np.array([[kxx, kxy], [kxy, kyy]])[:axes, :axes]
    damping = np.array([[dxx, dxy], [dxy, dyy]])[:axes, :axes]
    turn = np.array([[0.0, 2.0 * RATE], [-2.0 * RATE, 0.0]])[:axes, :axes]

    def missing(q: Floats, v: Floats) -> Floats:
        return A_FORCE * np.asarray(force(q / LENGTH, v / (LENGTH * OMEGA)))

    def slope(time: float, state: Floats) -> Floats:
        q, v = state[:axes], state[axes:]
        pull = -stiffness @ q - damping @ v + turn @ v + (RATE**2 * q if axes == 2 else 0.0)
        return np.concatenate([v, pull + drive(np.asarray(time)) + missing(q, v)])

    begin = np.array([1.0, 0.3])[:axes] * LENGTH
    start = np.concatenate([begin, np.zeros(axes)])
    solved = solve_ivp(slope, (0.0, t[-1]), start, "DOP853", t, rtol=1e-9, atol=1e-13, max_step=0.3 / OMEGA)
    position, velocity = solved.y[:axes].T, solved.y[axes:].T
    true = np.array([missing(q, v) for q, v in zip(position, velocity, strict=True)])
    return Simulated(position, velocity, true, problem_of(position, drive(t).T, rate_Hz, noise, seed))


def problem_of(position: Floats, drive: Floats, rate_Hz: float, noise: float, seed: int) -> Problem:
    """What a laboratory has of it."""
    axes = position.shape[1]
    rng = np.random.default_rng(seed)
    sense = GAIN * position + np.array(OFFSET[:axes]) + noise * GAIN * LENGTH * rng.standard_normal(position.shape)
    step = np.full(len(position), 1.0 / rate_Hz)
    record = Record(sense, drive_polynomials(drive, "bandlimited"), step)
    off = (1.01, 0.992, 0.7)
    device = Device(
        sample_rate=rate_Hz,
        stiffness=tuple(k * f for k, f in zip(STIFFNESS, off, strict=True))[: 3 if axes == 2 else 1],
        damping=tuple(d * f for d, f in zip(DAMPING, (0.8, 1.2, 0.5), strict=True))[: 3 if axes == 2 else 1],
        amplitude=LENGTH,
        sense_gain=(GAIN,) * axes,
        noise=(noise * GAIN * LENGTH,) * axes,
        target_stiffness=OMEGA**2,
    )
    random_walk = ProcessNoise(rate=0.01) if axes == 2 else ProcessNoise()
    return Problem(record, device, ObserverSettings(memory=1.0, spread=Spread(rate=3.0), process_noise=random_walk))
