"""Adaptive control: Park & Horowitz, "New adaptive mode of operation for MEMS gyroscopes", J. Dyn. Syst. Meas. Control
126(4), 800–810, 2004; the law is that of "Adaptive control for the conventional mode of operation of MEMS gyroscopes",
J. Microelectromech. Syst. 12(1), 101–108, 2003, with both axes vibrating.

    [observer]
    plugin = "park_horowitz.py:ParkHorowitz"

    [controller]
    plugin = "park_horowitz.py:ParkHorowitz"

The mass is made to follow a reference, x_m = X0 sin ω1 t and y_m = Y0 sin ω2 t with ω1 ≠ ω2, and what it takes to hold
it there tells stiffness, damping and rate.  With e = q − q_m, R = K − diag(ω1², ω2²) and J = [[0, −1], [1, 0]]

    u = R̂ q_m + D̂ q̇_m + 2Ω̂ J q̇_m − γ ė
    R̂' = −γR sym(ė q_mᵀ),    D̂' = −γD sym(ė q̇_mᵀ),    Ω̂' = −γΩ ėᵀ J q̇_m

of which V = ėᵀė + eᵀKe + squares of the parameter errors is a Lyapunov function; two frequencies excite all seven
unknowns.  The angle is ∫Ω̂ dt.  The velocity of the tracking error comes from an observer at the resonance, as in the
second paper.  What a sampled loop adds is given its due.  The reference is known ahead, so the feed-forward is that for
the middle of the interval in which it will act.  The feedback is turned by the same time.  Both are divided by what the
hold takes away (Park & Horowitz, Int. J. Adapt. Control Signal Process. 19, 485–503, 2005).  The adaptation waits until
the transient has passed.
"""

import math

import hil

Pair = tuple[float, float]
SPLIT = 0.2
"""Share of the drive limit that may go into holding each axis off the target frequency."""
FEEDBACK, PARAMETERS, RATE, OBSERVER = 0.2, 0.004, 0.08, 0.4
"""In units of ω0: γ, bandwidths of the adaptation of stiffness and damping, of the rate, and of the observer."""
SETTLE_CYCLES = 20.0
"""Before the adaptation begins."""


class ParkHorowitz:
    """Everything is scaled: time by ω0, motion by the amplitude."""

    def __init__(self, device: hil.DeclaredDevice) -> None:
        if device.sense_order != 0:
            raise ValueError("it needs the displacement sensed, not the velocity")
        self.omega = omega = math.sqrt(device.target_stiffness_per_s2)
        self.h = omega / device.sample_rate_Hz
        self.amplitude, self.gain = device.amplitude_m, device.angular_gain
        self.volts = [gain * device.amplitude_m for gain in device.sense_gain_V_per_m]
        self.force = device.amplitude_m * omega**2  # m/s² of a scaled one
        self.limit = device.drive_limit_mps2 / self.force
        self.references = (1.0 - 0.5 * SPLIT * self.limit, 1.0 + 0.5 * SPLIT * self.limit)
        self.k = [k / omega**2 for k in device.stiffness_per_s2]
        self.d = [d / omega for d in device.damping_per_s]
        self.rate = self.angle = 0.0
        self.ahead = (device.latency + 0.5) * self.h
        self.hold = math.sin(self.h / 2.0) / (self.h / 2.0)
        self.e, self.v = [0.0, 0.0], [0.0, 0.0]
        self.on = False
        self.t = 0.0  # of the reference
        self.shown = (0.0, 0.0)

    def observe(self, sense: Pair, applied: Pair, imposed: float) -> hil.Estimate:
        """As `hil.Observer`; applied and imposed are not used."""
        if not math.isnan(sense[0] + sense[1]):
            self.shown = sense[0] / self.volts[0], sense[1] / self.volts[1]
        qx, qy, px, py = self._reference(self.t)
        if self.on:
            self._track(sense, (qx, qy))
            if self.t > 2.0 * math.pi * SETTLE_CYCLES:
                self._adapt(qx, qy, px, py)
            self.t += self.h
        rate = self.rate * self.omega / self.gain
        self.angle += rate * self.h / self.omega
        scale, per_s, x = self.amplitude, self.amplitude * self.omega, self.shown
        units = {"k": self.omega**2, "d": self.omega}
        named = {f"k{axes}": k for axes, k in zip(("xx", "yy", "xy"), self.k, strict=True)}
        named |= {f"d{axes}": d for axes, d in zip(("xx", "yy", "xy"), self.d, strict=True)}
        return hil.Estimate(
            scale * x[0],
            per_s * (px + self.v[0]),
            scale * x[1],
            per_s * (py + self.v[1]),
            rate,
            self.angle,
            constants={name: value * units[name[0]] for name, value in named.items()},
        )

    def control(self, estimate: hil.Estimate, on: bool) -> hil.Drive:
        """As `hil.Controller`; the reference begins where the drive is applied."""
        self.on = on
        (ex, ey), (fx, fy) = self.e, self.v
        qx, qy, px, py = self._reference(self.t - self.h + self.ahead)
        w1, w2 = self.references
        (kxx, kyy, kxy), (dxx, dyy, dxy) = self.k, self.d
        c, s = math.cos(self.ahead), math.sin(self.ahead)
        fx, fy = c * fx - s * ex, c * fy - s * ey
        ux = (kxx - w1 * w1) * qx + kxy * qy + dxx * px + dxy * py - 2.0 * self.rate * py - FEEDBACK * fx
        uy = kxy * qx + (kyy - w2 * w2) * qy + dxy * px + dyy * py + 2.0 * self.rate * px - FEEDBACK * fy
        bounded = (min(max(u / self.hold, -self.limit), self.limit) for u in (ux, uy))
        return hil.Drive(*(u * self.force for u in bounded))

    def _reference(self, t: float) -> tuple[float, float, float, float]:
        """Displacement and velocity of both axes at the scaled time t."""
        w1, w2 = self.references
        return math.sin(w1 * t), math.sin(w2 * t), w1 * math.cos(w1 * t), w2 * math.cos(w2 * t)

    def _track(self, sense: Pair, reference: Pair) -> None:
        """Tracking error and its velocity, a sample on."""
        c, s, gain = math.cos(self.h), math.sin(self.h), OBSERVER * self.h
        for axis in range(2):
            e, v = self.e[axis], self.v[axis]
            e, v = c * e + s * v, c * v - s * e
            nu = sense[axis] / self.volts[axis] - reference[axis] - e
            if not math.isnan(nu):
                e, v = e + gain * nu, v + 0.5 * OBSERVER * gain * nu
            self.e[axis], self.v[axis] = e, v

    def _adapt(self, qx: float, qy: float, px: float, py: float) -> None:
        """Stiffness, damping and rate.  A bandwidth λ of one unknown alone: its force meets γ, and the mean square of
        the reference is a half.
        """
        fx, fy = self.v
        step, rate_step = 2.0 * FEEDBACK * PARAMETERS * self.h, FEEDBACK * RATE * self.h
        for unknown, x, y in ((self.k, qx, qy), (self.d, px, py)):
            unknown[0] -= step * fx * x
            unknown[1] -= step * fy * y
            unknown[2] -= step * 0.5 * (fx * y + fy * x)
        self.rate -= rate_step * 0.5 * (fy * px - fx * py)
