"""(d) Adaptive control: Park & Horowitz, "New adaptive mode of operation for MEMS gyroscopes", J. Dyn. Syst. Meas.
Control 126(4), 800–810, 2004; the law is that of "Adaptive control for the conventional mode of operation of MEMS
gyroscopes", J. Microelectromech. Syst. 12(1), 101–108, 2003, with both axes vibrating.

The mass is made to follow a reference, x_m = X0 sin ω1 t and y_m = Y0 sin ω2 t with ω1 ≠ ω2, and what it takes to hold
it there tells stiffness, damping and rate.  With e = q − q_m, R = K − diag(ω1², ω2²) and J = [[0, −1], [1, 0]]

    u = R̂ q_m + D̂ q̇_m + 2Ω̂ J q̇_m − γ ė
    R̂' = −γR sym(ė q_mᵀ),    D̂' = −γD sym(ė q̇_mᵀ),    Ω̂' = −γΩ ėᵀ J q̇_m

of which V = ėᵀė + eᵀKe + squares of the parameter errors is a Lyapunov function; two frequencies excite all seven
unknowns.  The angle is ∫Ω̂ dt.  The velocity of the tracking error comes from an observer at the resonance, as in the
second paper.  What a sampled loop adds is given its due: the reference is known ahead, so feed-forward is evaluated for
the middle of the interval in which it will act, the feedback is turned by the same time, and both are divided by what
the hold takes away (Park & Horowitz, Int. J. Adapt. Control Signal Process. 19, 485–503, 2005, on what it costs to
leave that out).  The adaptation waits until the transient has passed.
"""

import math
from dataclasses import dataclass

import numpy as np

from estimator.errors import ModelError
from estimator.prior_art.reading import Reading, require_displacement
from estimator.settings import ControllerSettings, Device

_SPLIT = 0.2
"""Share of the force limit that may go into holding each axis off the target frequency."""


@dataclass(frozen=True)
class Gains:
    """In units of ω0: γ of the feedback, bandwidths of the adaptation of stiffness and damping, of the rate, and of the
    observer; settle [cycles] before the adaptation begins."""

    feedback: float = 0.2
    parameters: float = 0.004
    rate: float = 0.08
    observer: float = 0.4
    settle: float = 20.0


class ParkHorowitz:
    """The controller: `tick` takes a sample and answers with drive codes, `reading` is what it made of the run.

    Raises ModelError for a device of one axis, or whose channels show a velocity.
    """

    def __init__(self, device: Device, control: ControllerSettings, gains: Gains | None = None) -> None:
        if device.axes != 2:
            raise ModelError("adaptive control needs two axes, the device has one")
        require_displacement(device)
        self._device, self._control = device, control
        self._gains = gains = gains or Gains()
        omega0 = math.sqrt(device.target)
        self._omega0, self._h = omega0, omega0 / device.sample_rate
        force = device.amplitude * omega0**2
        self._limit = control.force_limit / force
        self._quantum = control.force_quantum / force
        self._volts = [control.sense_quantum / (gain * device.amplitude) for gain in device.sense_gain]
        apart = 0.5 * _SPLIT * self._limit
        self._omega = (1.0 - apart, 1.0 + apart)
        self._k = [k / omega0**2 for k in device.stiffness]
        self._d = [d / omega0 for d in device.damping]
        self._rate = 0.0
        self._ahead = (control.latency + 0.5) * self._h
        self._hold = math.sin(self._h / 2) / (self._h / 2)
        self._turn = math.cos(self._ahead), math.sin(self._ahead)
        self._flow = math.cos(self._h), math.sin(self._h)
        self._e, self._v = [0.0, 0.0], [0.0, 0.0]
        self._m = 0
        # A bandwidth λ of one unknown alone: its force meets γ, and the reference's mean square is a half.
        self._step = 2.0 * gains.feedback * gains.parameters * self._h
        self._rate_step = gains.feedback * gains.rate * self._h
        self._track: list[tuple[float, ...]] = []

    def tick(self, vx: float, vy: float, ux: float, uy: float) -> tuple[int, int]:
        """Sense codes, NaN where lost, and the drive codes that acted (which this method does not use) in; drive codes
        out.
        """
        h, (w1, w2), gains = self._h, self._omega, self._gains
        t = self._m * h
        self._m += 1
        c, s = self._flow
        qx, qy = math.sin(w1 * t), math.sin(w2 * t)
        px, py = w1 * math.cos(w1 * t), w2 * math.cos(w2 * t)
        for axis, (code, q) in enumerate(((vx, qx), (vy, qy))):
            e, v = self._e[axis], self._v[axis]
            e, v = c * e + s * v, c * v - s * e
            if code == code:
                nu = code * self._volts[axis] - q - e
                e, v = e + gains.observer * self._h * nu, v
                v += 0.5 * gains.observer**2 * self._h * nu
            self._e[axis], self._v[axis] = e, v
        (ex, ey), (fx, fy) = self._e, self._v
        if t > 2.0 * math.pi * gains.settle:
            step, k, d = self._step, self._k, self._d
            k[0] -= step * fx * qx
            k[1] -= step * fy * qy
            k[2] -= step * 0.5 * (fx * qy + fy * qx)
            d[0] -= step * fx * px
            d[1] -= step * fy * py
            d[2] -= step * 0.5 * (fx * py + fy * px)
            self._rate -= self._rate_step * 0.5 * (fy * px - fx * py)
        self._track.append((*self._k, *self._d, self._rate))
        return self._drive(t + self._ahead, ex, ey, fx, fy)

    def _drive(self, t: float, ex: float, ey: float, fx: float, fy: float) -> tuple[int, int]:
        """Codes for the interval whose middle is the scaled time t."""
        (w1, w2), (c, s), (kxx, kyy, kxy), (dxx, dyy, dxy) = self._omega, self._turn, self._k, self._d
        qx, qy = math.sin(w1 * t), math.sin(w2 * t)
        px, py = w1 * math.cos(w1 * t), w2 * math.cos(w2 * t)
        fx, fy = c * fx - s * ex, c * fy - s * ey
        gamma, rate = self._gains.feedback, self._rate
        ux = (kxx - w1 * w1) * qx + kxy * qy + dxx * px + dxy * py - 2.0 * rate * py - gamma * fx
        uy = kxy * qx + (kyy - w2 * w2) * qy + dxy * px + dyy * py + 2.0 * rate * px - gamma * fy
        bound, scale = self._limit, 1.0 / self._hold
        cx, cy = (round(min(max(u * scale, -bound), bound) / self._quantum) for u in (ux, uy))
        return cx, cy

    @property
    def reading(self) -> Reading:
        """Rate, parameters and ∫Ω̂ dt after every sample so far, SI."""
        track = np.array(self._track).reshape(-1, 7)
        rate = track[:, 6] * self._omega0 / self._device.angular_gain
        scale = np.array([self._omega0**2] * 3 + [self._omega0] * 3)
        names = ("kxx", "kyy", "kxy", "dxx", "dyy", "dxy")
        parameters = {name: track[:, i] * scale[i] for i, name in enumerate(names)}
        return Reading(np.arange(len(track)), np.cumsum(rate) / self._device.sample_rate, rate, parameters)
