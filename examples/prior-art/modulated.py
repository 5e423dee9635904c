"""The rate estimated from the equations of motion, and its integral as the angle: what the patent calls prior art, as
strong as it can be made without a model of the sense chain.

Multiplied by a modulating function φ that vanishes with its first derivatives at both ends of a window and integrated
by parts, the equations of motion

    ∫φ̈ x − dxx ∫φ̇ x − (dxy − 2Ω) ∫φ̇ y + kxx ∫φ x + kxy ∫φ y = ∫φ ux,      y likewise,

are linear in the seven unknowns and need no derivative of a measured signal (Shinbrot, Trans. ASME 79, 1957; for a
gyro's rate and parameters: Fei & Yang, Math. Probl. Eng. 2011, 829432).  φ is a squared Hann window over six periods
times the vibration's own carrier, so that an offset has no part in the integrals.  Window after window a linear Kalman
filter takes the four real equations.  Stiffness and damping are constant, the rate is a random walk.  Centrifugal and
Euler terms are left out; they are Ω/ω0 of the Coriolis one.

    [observer]
    plugin = "modulated.py:ModulatedRate"
"""

import math
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hil

Array = NDArray[Any]
Pair = tuple[float, float]
CYCLES = 6
SPREAD = {"stiffness": 0.05, "damping": 1.0, "rate_rad_s": 2.0}
"""Standard deviations at first: of the target stiffness, of the declared damping, and of the rate."""
WALK = 1.0
"""Of the rate, rad/s per square root of a second."""
NAMES = ("kxx", "kyy", "kxy", "dxx", "dyy", "dxy")
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


class ModulatedRate:
    """Everything is scaled: time by ω0, motion by the amplitude."""

    def __init__(self, device: hil.DeclaredDevice) -> None:
        if device.sense_order != 0:
            raise ValueError("it needs the displacement sensed, not the velocity")
        self.omega = omega = math.sqrt(device.target_stiffness_per_s2)
        self.amplitude, self.gain = device.amplitude_m, device.angular_gain
        self.volts = [gain * device.amplitude_m for gain in device.sense_gain_V_per_m]
        self.step_s = 1.0 / device.sample_rate_Hz
        self.half = round(0.5 * CYCLES * 2.0 * math.pi / (omega * self.step_s))
        self.hop = max(self.half // 2, 1)
        self.functions, self.pushing = _modulating(self.half, omega * self.step_s)
        length = 2 * self.half + 1
        self.position = deque([(math.nan, math.nan)] * length, maxlen=length)
        self.force = deque([(0.0, 0.0)] * (length - 1), maxlen=length - 1)
        self.filter = _Filter(device, self.functions, self.hop * self.step_s)
        self.per_force = 1.0 / (device.amplitude_m * omega**2)
        self.samples = 0
        self.turned = 0.0  # rad, up to the middle of the last window
        self.last = [(0.0, 0.0)] * 2
        self._tell()

    def observe(self, sense: Pair, applied: Pair, imposed: float) -> hil.Estimate:
        """As `hil.Observer`."""
        x, y = sense[0] / self.volts[0], sense[1] / self.volts[1]
        self.position.append((x, y))
        self.force.append((applied[0] * self.per_force, applied[1] * self.per_force))
        self.samples += 1
        if not math.isnan(x + y):
            self.last = [self.last[1], (x, y)]
        since = self.samples - 2 * self.half - 1
        if since >= 0 and since % self.hop == 0:
            self._take_window()
        ahead = (self.half + max(since, 0) % self.hop) * self.step_s if since >= 0 else 0.0
        (x0, y0), (x, y) = self.last
        return hil.Estimate(
            x=x * self.amplitude,
            vx=(x - x0) * self.amplitude / self.step_s,
            y=y * self.amplitude,
            vy=(y - y0) * self.amplitude / self.step_s,
            rate=self.rate,
            angle=self.turned + ahead * self.rate,
            constants=self.constants,
            deviation=self.deviation,
        )

    def _take_window(self) -> None:
        """What the samples that are there say; of one with a lost sample nothing."""
        before = self.rate
        moments = np.array(self.position).T @ self.functions.T
        self.filter.take(moments, self.pushing @ np.array(self.force))
        self._tell()
        if self.samples > 2 * self.half + 1:
            self.turned += 0.5 * (before + self.rate) * self.hop * self.step_s

    def _tell(self) -> None:
        """Rate and constants in SI, with their standard deviations."""
        units = [self.omega**2] * 3 + [self.omega] * 3 + [self.omega / self.gain]
        values, deviations = self.filter.x * units, np.sqrt(np.diag(self.filter.p)) * units
        self.rate = float(values[6])
        self.constants = dict(zip(NAMES, values[:6].tolist(), strict=True))
        self.deviation = dict(zip((*NAMES, "rate"), deviations.tolist(), strict=True))


class _Filter:
    """Kalman filter of stiffness, damping and rate, scaled (7,), by a window's four equations."""

    def __init__(self, device: hil.DeclaredDevice, functions: Array, seconds: float) -> None:
        omega = math.sqrt(device.target_stiffness_per_s2)
        damping = np.array(device.damping_per_s) / omega
        self.x = np.array([*np.array(device.stiffness_per_s2) / omega**2, *damping, 0.0])
        sd = [SPREAD["stiffness"]] * 3 + [SPREAD["damping"] * damping[:2].mean()] * 3 + [SPREAD["rate_rad_s"] / omega]
        self.p = np.diag(np.square(sd))
        self.walk = np.diag([0.0] * 6 + [(WALK / omega) ** 2 * seconds])
        noise = device.noise_V / (np.abs(device.sense_gain_V_per_m) * device.amplitude_m)
        # Noise of the sense goes through φ̈ + φ, the resonance itself being known well enough for it.
        self.r = np.diag(np.repeat(noise**2 * np.sum(np.abs(functions[2] + functions[0]) ** 2) / 2.0, 2))

    def take(self, moments: Array, pushed: Array) -> None:
        """moments (2, [φ φ̇ φ̈]) of both axes, pushed (2,) by the drive, complex; NaN where a sample was lost."""
        self.p = self.p + self.walk
        if not np.isfinite(moments).all():
            return
        (x0, x1, x2), (y0, y1, y2) = moments
        h = np.array([[x0, 0.0, y0, -x1, 0.0, -y1, 2.0 * y1], [0.0, y0, x0, 0.0, -y1, -x1, -2.0 * x1]])
        z = pushed - np.array([x2, y2])
        h = np.stack([h.real, h.imag], axis=1).reshape(4, 7)
        z = np.stack([z.real, z.imag], axis=1).ravel()
        k = np.linalg.solve(h @ self.p @ h.T + self.r, h @ self.p).T
        self.x = self.x + k @ (z - h @ self.x)
        p = self.p - k @ h @ self.p
        self.p = 0.5 * (p + p.T)


def _modulating(half: int, step: float) -> tuple[Array, Array]:
    """Weights of the samples in ∫φ·, ∫φ̇·, ∫φ̈· (3, window), complex, and of the drive held over each interval
    (window − 1,).
    """
    turn = math.pi / (half * step)

    def carried(t: Array) -> tuple[Array, Array, Array]:
        hann = 0.5 * (1.0 + np.cos(turn * t))
        slope, bend = -0.5 * turn * np.sin(turn * t), -0.5 * turn**2 * np.cos(turn * t)
        w, dw, ddw = hann**2, 2.0 * hann * slope, 2.0 * (slope**2 + hann * bend)
        carrier = np.exp(-1j * t)
        return w * carrier, (dw - 1j * w) * carrier, (ddw - 2j * dw - w) * carrier

    at = step * np.arange(-half, half + 1)
    within = np.add.outer(at[:-1], step * 0.5 * (_NODES + 1.0))
    return np.stack(carried(at)) * step, 0.5 * step * (carried(within)[0] @ _WEIGHTS)
