"""(a) The rate is estimated, and its integral is the angle.

The estimate is the best that the equations of motion (2) give without modelling the sense chain: multiplied by a
modulating function φ that vanishes with its first derivatives at both ends of a window and integrated by parts,

    ∫φ̈ x − dxx ∫φ̇ x − (dxy − 2Ω) ∫φ̇ y + kxx ∫φ x + kxy ∫φ y = ∫φ ux,      y likewise,

they are linear in the seven unknowns and need no derivative of a measured signal (Shinbrot, Trans. ASME 79, 1957; the
online identification of a gyro's rate and parameters from its own equations: Fei & Yang, Math. Probl. Eng. 2011,
829432).  φ is a squared Hann window over six periods times the vibration's own carrier, so that an offset has no part
in the integrals.  Window after window a linear Kalman filter takes the four real equations; stiffness and damping are
constant, the rate is a random walk as the data sheet declares.  What is left out are the centrifugal and Euler terms,
which are Ω/ω0 of the Coriolis one.  The rate is that of the middle of a window, and the angle is carried on to
its end by it.
"""

import math
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from estimator.errors import ModelError
from estimator.prior_art.reading import Reading, displacement, require_displacement, samples_per_cycle
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings

CYCLES = 6
NAMES = ("kxx", "kyy", "kxy", "dxx", "dyy", "dxy", "rate")
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


def read(sense: Array, drive: Array, device: Device, settings: ObserverSettings) -> Reading:
    """Rate, parameters and angle over an evenly sampled record: sense (n, 2) in volts, NaN where lost, drive (n, 2) or
    (n, 2, degree + 1) in the drive's unit, as `Observer.run` takes them.  Raises ModelError for less than one window,
    and for channels that show a velocity.
    """
    require_displacement(device)
    omega0, rate_Hz = math.sqrt(device.target), device.sample_rate
    position = displacement(sense, device) / device.amplitude
    n = len(position)
    force = np.asarray(drive, dtype=float).reshape(n, 2, -1) * (device.drive_gain / (device.amplitude * omega0**2))
    half = round(0.5 * CYCLES * samples_per_cycle(device))
    if n < 2 * half + 1:
        raise ModelError(f"{n} samples are less than {CYCLES} cycles; give a longer record")
    step = omega0 / rate_Hz  # scaled time from here on
    functions, over_intervals = _modulating(half, step, force.shape[2])
    hop = max(half // 2, 1)
    windows = sliding_window_view(position, 2 * half + 1, axis=0)[::hop]  # (rows, 2, window)
    forces = sliding_window_view(force, 2 * half, axis=0)[1::hop]  # (rows, 2, degree + 1, window − 1)
    moments = windows @ functions.T  # (rows, 2, [φ φ̇ φ̈])
    pushed = np.einsum("radi,di->ra", forces, over_intervals)
    rows = min(len(moments), len(pushed))
    index = 2 * half + hop * np.arange(rows)
    told = _filtered(moments[:rows], pushed[:rows], functions, device, settings, hop / rate_Hz)
    si = np.array([omega0**2] * 3 + [omega0] * 3 + [omega0 / device.angular_gain])
    values = told * si
    rate = values[:, 6]
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) * hop / rate_Hz
    angle += rate * half / rate_Hz
    return Reading(index, angle, rate, {name: values[:, i] for i, name in enumerate(NAMES[:6])})


def _modulating(half: int, step: float, degrees: int) -> tuple[Array, Array]:
    """Weights of the samples in ∫φ·, ∫φ̇·, ∫φ̈· (3, window), complex, and of the drive's polynomials over each interval
    (degrees, window − 1).
    """
    width = 2.0 * half * step

    def carried(t: NDArray[np.floating[Any]]) -> tuple[Array, Array, Array]:
        turn = 2.0 * math.pi / width
        hann, slope = 0.5 * (1.0 + np.cos(turn * t)), -0.5 * turn * np.sin(turn * t)
        bend = -0.5 * turn**2 * np.cos(turn * t)
        w, dw, ddw = hann**2, 2.0 * hann * slope, 2.0 * (slope**2 + hann * bend)
        carrier = np.exp(-1j * t)
        return w * carrier, (dw - 1j * w) * carrier, (ddw - 2j * dw - w) * carrier

    at = step * np.arange(-half, half + 1)
    inside = np.asarray(0.5 * (_NODES + 1.0), dtype=float)
    within: Array = np.add.outer(at[:-1], step * inside)
    phi = carried(within)[0]
    powers = inside[None, :] ** np.arange(degrees)[:, None]
    return np.stack(carried(at)) * step, 0.5 * step * np.einsum("in,dn,n->di", phi, powers, _WEIGHTS)


def _filtered(
    moments: Array, pushed: Array, functions: Array, device: Device, settings: ObserverSettings, seconds: float
) -> Array:
    """The seven unknowns, scaled, after each window (rows, 7)."""
    omega0, spread = math.sqrt(device.target), settings.spread
    mean = sum(device.damping[:2]) / 2.0 / omega0
    start = {"kxx": 0, "kyy": 1, "kxy": 2, "dxx": 3, "dyy": 4, "dxy": 5, "rate": 6}
    x = np.array([*np.array(device.stiffness) / omega0**2, *np.array(device.damping) / omega0, 0.0])
    for name, value in settings.initial.items():
        if name in start:
            x[start[name]] = value / (omega0**2 if name.startswith("k") else omega0)
    x[6] *= device.angular_gain
    sd = np.array([spread.stiffness] * 3 + [spread.damping * mean] * 3 + [spread.rate / omega0])
    p = np.diag(sd**2)
    random_walk = np.zeros((7, 7))
    random_walk[6, 6] = (settings.process_noise.rate / omega0) ** 2 * seconds
    noise = np.array(device.noise) / (np.abs(device.sense_gain) * device.amplitude)
    # Noise of the sense goes through φ̈ + φ, the resonance itself being known well enough for it.
    gain = float(np.sum(np.abs(functions[2] + functions[0]) ** 2)) / 2.0
    r = np.diag(np.repeat(noise**2 * gain, 2))
    told = np.zeros((len(moments), 7))
    for row, ((x0, x1, x2), (y0, y1, y2)) in enumerate(moments):
        p = p + random_walk
        if np.isfinite(x0 + y0):
            o = 0.0 * x0
            h = np.array([[x0, o, y0, -x1, o, -y1, 2.0 * y1], [o, y0, x0, o, -y1, -x1, -2.0 * x1]])
            z = pushed[row] - np.array([x2, y2])
            h = np.stack([h.real, h.imag], axis=1).reshape(4, 7)
            z = np.stack([z.real, z.imag], axis=1).ravel()
            k = np.linalg.solve(h @ p @ h.T + r, h @ p).T
            x = x + k @ (z - h @ x)
            p = p - k @ h @ p
            p = 0.5 * (p + p.T)
        told[row] = x
    return told
