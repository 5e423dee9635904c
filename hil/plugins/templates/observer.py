"""An observer of one's own: change it, it runs as it is.

    [observer]
    plugin = "observer.py:MyObserver"

It follows both axes by in-phase and quadrature components in the frame of a phase that is locked to the motion, with
the sense offset beside them (an adaptive notch: Widrow et al., Proc. IEEE 63(12), 1975), and reads the angle of the
pattern from them (Lynch, Symposium Gyro Technology, 1995).  It knows nothing of stiffness and damping.
"""

import math

import hil

BANDWIDTH = 0.2
"""Of components and phase, in units of the resonance; a controller that is as fast does not see it as a delay."""


class MyObserver:
    """Made anew for each run."""

    def __init__(self, device: hil.DeclaredDevice) -> None:
        if device.sense_order != 0:
            raise ValueError("it needs the displacement sensed, not the velocity")
        self.device = device
        self.step_s = 1.0 / device.sample_rate_Hz
        self.omega = math.sqrt(device.target_stiffness_per_s2)
        self.gain = BANDWIDTH * self.omega * self.step_s  # of a component, a sample
        self.phase = 0.0
        self.components = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]  # of each axis, V: cosine, sine, offset
        self.theta = self.theta_before = 0.0
        self.turn = 0.0  # of the pattern, since the first sample
        self.imposed = 0.0  # of it, by virtual rotation
        self.rate = 0.0
        self.samples = 0

    def observe(self, sense: tuple[float, float], applied: tuple[float, float], imposed: float) -> hil.Estimate:
        """One sample: sense in V, NaN where it was lost; applied: the drive that acted up to it, m/s²; imposed: the
        rotation of the pattern by it, rad/s.
        """
        self.phase += self.omega * self.step_s
        cosine, sine = math.cos(self.phase), math.sin(self.phase)
        innovation = [math.nan, math.nan]
        if not math.isnan(sense[0]):
            for axis, parts in enumerate(self.components):
                error = sense[axis] - (parts[0] * cosine + parts[1] * sine + parts[2])
                innovation[axis] = error
                parts[0] += 2.0 * self.gain * error * cosine
                parts[1] += 2.0 * self.gain * error * sine
                parts[2] += 0.1 * self.gain * error
        (cx, sx), (cy, sy) = self._displacements()
        self._lock(cx, sx, cy, sy)
        rate = self._turned(cx, sx, cy, sy, imposed)
        w = self.omega
        return hil.Estimate(
            x=cx * cosine + sx * sine,
            vx=w * (sx * cosine - cx * sine),
            y=cy * cosine + sy * sine,
            vy=w * (sy * cosine - cy * sine),
            rate=rate,
            angle=(-self.turn - self.imposed) / self.device.angular_gain,
            constants={"phi_x": self.components[0][2], "phi_y": self.components[1][2]},
            innovation=(innovation[0], innovation[1]),
        )

    def _displacements(self) -> list[tuple[float, float]]:
        """The components in m."""
        gains = self.device.sense_gain_V_per_m
        return [(parts[0] / gain, parts[1] / gain) for parts, gain in zip(self.components, gains, strict=True)]

    def _lock(self, cx: float, sx: float, cy: float, sy: float) -> None:
        """Turn the phase to where the motion is largest."""
        error = 0.5 * math.atan2(-2.0 * (cx * sx + cy * sy), cx * cx + cy * cy - sx * sx - sy * sy)
        self.phase += 0.5 * self.gain * error
        self.omega += 0.1 * self.gain**2 * error / self.step_s

    def _turned(self, cx: float, sx: float, cy: float, sy: float, imposed: float) -> float:
        """Count the pattern's turn, of which the angle is known modulo a half turn; the rate, rad/s."""
        theta = 0.5 * math.atan2(2.0 * (cx * cy + sx * sy), cx * cx + sx * sx - cy * cy - sy * sy)
        change = (theta - self.theta + 0.5 * math.pi) % math.pi - 0.5 * math.pi
        self.theta = theta
        self.samples += 1
        if self.samples * self.gain < 5.0:  # the components have not settled
            return 0.0
        self.turn += change
        self.imposed += imposed * self.step_s
        self.rate += self.gain * (-change / self.step_s - imposed - self.rate)
        return self.rate / self.device.angular_gain
