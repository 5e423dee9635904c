"""A controller of one's own: change it, it runs as it is.

    [controller]
    plugin = "controller.py:MyController"

It makes the mass an isotropic oscillator by the constants that it is given, holds the energy, and turns the vibration
into a line.
"""

import math

import hil

ENERGY_GAIN = QUADRATURE_GAIN = 0.1
"""In units of the frequency."""


class MyController:
    """Made anew for each run."""

    def __init__(self, device: hil.DeclaredDevice) -> None:
        self.device = device
        self.k = device.target_stiffness_per_s2
        self.omega = math.sqrt(self.k)
        self.energy = 0.5 * self.k * device.amplitude_m**2
        self.ahead = (device.latency + 0.5) * self.omega / device.sample_rate_Hz  # rad, to the middle of what acts

    def control(self, estimate: hil.Estimate, on: bool) -> hil.Drive:
        """The force per mass, m/s², for the interval `latency` samples on; on: whether it will be applied."""
        x, vx = self._later(estimate.x, estimate.vx)
        y, vy = self._later(estimate.y, estimate.vy)
        k, known = self.k, estimate.constants
        energy = 0.5 * (k * (x * x + y * y) + vx * vx + vy * vy)
        along = ENERGY_GAIN * self.omega * min(max(1.0 - energy / self.energy, -1.0), 1.0)
        ratio = self.omega * (x * vy - y * vx) / max(energy, 1e-3 * self.energy)
        across = QUADRATURE_GAIN * k * min(max(ratio, -1.0), 1.0)
        turning = 2.0 * self.device.virtual_rotation_rad_s
        ux = known["dxx"] * vx + known["dxy"] * vy + (known["kxx"] - k) * x + known["kxy"] * y
        uy = known["dxy"] * vx + known["dyy"] * vy + known["kxy"] * x + (known["kyy"] - k) * y
        return hil.Drive(
            self._within(ux + along * vx + across * y + turning * vy),
            self._within(uy + along * vy - across * x - turning * vx),
            self.device.virtual_rotation_rad_s,
        )

    def _later(self, position: float, velocity: float) -> tuple[float, float]:
        """Where the free oscillation will be when the force acts."""
        cosine, sine = math.cos(self.ahead), math.sin(self.ahead)
        return position * cosine + velocity / self.omega * sine, velocity * cosine - position * self.omega * sine

    def _within(self, force: float) -> float:
        """No more than the drive can do: beyond its limit the run would end."""
        limit = self.device.drive_limit_mps2
        return min(max(force, -limit), limit)
