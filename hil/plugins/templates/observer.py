"""An observer of one's own: change it, it runs as it is.

    [observer]
    plugin = "observer.py:MyObserver"

It predicts the motion by the drive that acted, corrects it by the sample, and lets what is left change springs and rate
(Luenberger's observer, made adaptive by the gradient: Ioannou & Sun, Robust Adaptive Control, 1996, chapters 4 and 5).
The angle of the pattern is Friedland and Hutton's (IEEE Trans. Automatic Control 23(4), 1978), with the turn by forces
taken off.  Damping is taken as declared.
"""

import math

import hil

BANDWIDTH = 0.2
"""Of the motion, in units of the resonance; a controller that is as fast does not see it as a delay."""
ADAPTATION = 0.02
"""Of springs and rate, likewise; well below the motion's."""


class MyObserver:
    """Made anew for each run."""

    def __init__(self, device: hil.DeclaredDevice) -> None:
        if device.sense_order != 0:
            raise ValueError("it needs the displacement sensed, not the velocity")
        self.device = device
        self.target = device.target_stiffness_per_s2
        self.omega = math.sqrt(self.target)
        self.step_s = 1.0 / device.sample_rate_Hz
        self.half = 0.5 * self.omega * self.step_s  # rad, of the vibration in half a sample
        self.hold = math.sin(self.half) / self.half  # what it leaves of a force
        self.gain = 2.0 * BANDWIDTH * self.omega * self.step_s  # of a displacement, a sample
        self.motion = (0.0, 0.0, 0.0, 0.0)  # m: x, vx / omega, y, vy / omega
        self.offset = [0.0, 0.0]  # V
        self.springs = list(device.stiffness_per_s2)  # xx, yy, xy
        self.softened = (0.0, 0.0, 0.0)  # of these, by trim electrodes
        self.rate = 0.0
        self.theta = 0.0  # of the pattern, modulo a half turn
        self.turned = 0.0  # of it, by no force
        self.samples = 0

    def observe(self, sense: tuple[float, float], applied: tuple[float, float], imposed: float) -> hil.Estimate:
        """One sample: sense in V, NaN where it was lost; applied: the drive that acted up to it, m/s²; imposed: the
        rotation of the pattern by it, rad/s, which is in `applied` already.
        """
        forced = self._predict(applied)
        innovation = self._correct(sense) if not math.isnan(sense[0]) else (math.nan, math.nan)
        theta = _pattern_angle(*self.motion)
        if self._settled():
            self.turned += _within_half_turn(theta - self.theta) - forced
        self.theta = theta
        self.samples += 1
        x, vx, y, vy = self.motion
        kxx, kyy, kxy = self.springs
        return hil.Estimate(
            x=x,
            vx=self.omega * vx,
            y=y,
            vy=self.omega * vy,
            rate=self.rate,
            angle=-self.turned / self.device.angular_gain,
            constants={"phi_x": self.offset[0], "phi_y": self.offset[1], "kxx": kxx, "kyy": kyy, "kxy": kxy},
            innovation=innovation,
        )

    def trimmed(self, trims: hil.TrimVoltages) -> None:
        """Called before `observe` where a trim voltage has changed: the springs follow it."""
        for i, now in enumerate(trims.softened):
            self.springs[i] += self.softened[i] - now
        self.softened = trims.softened

    def _settled(self) -> bool:
        """Whether the motion is known."""
        return 0.5 * self.gain * self.samples > 5.0

    def _predict(self, applied: tuple[float, float]) -> float:
        """A sample on: half a sample of free vibration at the target, all that acts beside it, and the other half.
        Gives the turn of the pattern by forces.
        """
        x, vx, y, vy = _vibrated(self.motion, self.half)
        (kxx, kyy, kxy), (dxx, dyy, dxy) = self.springs, self.device.damping_per_s
        before, w = _pattern_angle(x, vx, y, vy), self.omega
        ax = applied[0] * self.hold - (kxx - self.target) * x - kxy * y - w * (dxx * vx + dxy * vy)
        ay = applied[1] * self.hold - (kyy - self.target) * y - kxy * x - w * (dyy * vy + dxy * vx)
        vx, vy = vx + ax * self.step_s / w, vy + ay * self.step_s / w
        forced = _within_half_turn(_pattern_angle(x, vx, y, vy) - before)
        coriolis = 2.0 * self.device.angular_gain * self.rate * self.step_s
        self.motion = _vibrated((x, vx + coriolis * vy, y, vy - coriolis * vx), self.half)
        return forced

    def _correct(self, sense: tuple[float, float]) -> tuple[float, float]:
        """Take the sample in; what it was beside the prediction, V."""
        x, vx, y, vy = self.motion
        (gx, gy), w = self.device.sense_gain_V_per_m, self.omega
        nx, ny = sense[0] - gx * x - self.offset[0], sense[1] - gy * y - self.offset[1]
        ex, ey = nx / gx, ny / gy
        if self._settled():  # each by what the displacement owes to it, a quarter of a period behind the force
            least = (0.1 * self.device.amplitude_m) ** 2
            step = 2.0 * ADAPTATION * self.gain / max(x * x + vx * vx + y * y + vy * vy, least)
            self.springs[0] += step * w * w * ex * vx
            self.springs[1] += step * w * w * ey * vy
            self.springs[2] += step * w * w * 0.5 * (ex * vy + ey * vx)
            self.rate += step * w * 0.5 * (ex * y - ey * x) / self.device.angular_gain
        self.motion = (x + self.gain * ex, vx, y + self.gain * ey, vy)
        self.offset[0] += 0.05 * self.gain * nx
        self.offset[1] += 0.05 * self.gain * ny
        return nx, ny


def _vibrated(motion: tuple[float, float, float, float], angle: float) -> tuple[float, float, float, float]:
    """So far on in the free vibration, rad."""
    (x, vx, y, vy), c, s = motion, math.cos(angle), math.sin(angle)
    return c * x + s * vx, c * vx - s * x, c * y + s * vy, c * vy - s * y


def _pattern_angle(x: float, vx: float, y: float, vy: float) -> float:
    return 0.5 * math.atan2(2.0 * (x * y + vx * vy), x * x + vx * vx - y * y - vy * vy)


def _within_half_turn(angle: float) -> float:
    return (angle + 0.5 * math.pi) % math.pi - 0.5 * math.pi
