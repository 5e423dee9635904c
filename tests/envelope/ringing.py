"""Ring-downs by SciPy's integration of the full equation of motion; the amplitude is read off at the turning points."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

RESONANCE_HZ = 30.0
OMEGA0 = 2.0 * np.pi * RESONANCE_HZ
DAMPING = 0.6  # 1/s: a quality factor of 314
AMPLITUDE_M = 1e-3
GAIN = 1e3  # mm
SPEED = OMEGA0 * AMPLITUDE_M

LAWS = {
    "nonlinear_damping": ("d3x", 2.4 / AMPLITUDE_M**2, lambda x, v: x**2 * v),
    "dry_friction": ("fx", 0.06 * SPEED, lambda x, v: np.tanh(v / (1e-4 * SPEED))),
    "drag": ("dqx", 0.9 / SPEED, lambda x, v: abs(v) * v),
    "cubic_damping": ("dcx", 0.8 / SPEED**2, lambda x, v: v**3),
}
"""By effect: its coefficient, a size that takes about as much energy at the start as the damping, and c f(x, v) / c."""


def turning_points(laws, seconds, damping=DAMPING, start=AMPLITUDE_M):
    """Times and amplitudes of |x| where v is zero, of ẍ + d v + Σ c f(x, v) + ω0² x = 0 from x = `start` at rest."""

    def slope(t, state):
        x, v = state
        return [v, -damping * v - sum(c * f(x, v) for c, f in laws) - OMEGA0**2 * x]

    def turns(t, state):
        return state[1]

    solved = solve_ivp(slope, (0.0, seconds), (start, 0.0), "DOP853", events=turns, rtol=1e-9, atol=1e-16)
    times, states = solved.t_events[0], solved.y_events[0]
    size = np.abs(states[:, 0])
    keep = np.concatenate([[True], np.diff(times) > 0.25 / RESONANCE_HZ]) & (size > 1e-5 * start)
    return times[keep], size[keep]


def envelope_of(laws, seconds, rate_Hz=40.0, **given):
    """Times (n,) and the amplitude (n,) m there, between the turning points by a spline through its logarithm."""
    times, size = turning_points(laws, seconds + 0.1, **given)
    at = np.arange(0.0, min(seconds, times[-1]), 1.0 / rate_Hz)
    return at, np.exp(CubicSpline(times, np.log(size))(at))


def decibels(amplitude, noise_dB, seed=3):
    """What a sensor of GAIN per metre shows, in dB of one of its units."""
    rng = np.random.default_rng(seed)
    return 20.0 * np.log10(GAIN * amplitude) + rng.normal(0.0, noise_dB, len(amplitude))
