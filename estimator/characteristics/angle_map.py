"""What a whole-angle device's rate is off by at each angle of its pattern, and taking that off.

    reported rate − true rate = Σ over k of b_k(θ) + s_k(θ) Ω,   b_k(θ) = a cos kθ + b sin kθ, s_k alike

θ is the pattern's angle in the device's frame (IEEE Std 1431, annex B). The pattern after half a turn is the same, so
that only even harmonics can be of the device.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from estimator.characteristics.stretches import HARMONICS

Floats = npt.NDArray[np.float64]


def pattern_angle(x: Floats, vx: Floats, y: Floats, vy: Floats, stiffness_per_s2: float) -> Floats:
    """θ (n,) of the ellipse, in a half turn: the source's formula (11)."""
    k = stiffness_per_s2
    return np.asarray(0.5 * np.arctan2(2.0 * (k * x * y + vx * vy), k * (x**2 - y**2) + vx**2 - vy**2))


@dataclass(frozen=True)
class AngleMap:
    """bias [rad/s] and scale factor [1]: coefficients of cos kθ and of sin kθ, (2, 4) each, k = 1 … 4."""

    bias: Floats
    scale: Floats

    def at(self, theta: Floats) -> tuple[Floats, Floats]:
        """Both (n,) at θ (n,)."""
        turns = np.stack([turn(k * theta) for turn in (np.cos, np.sin) for k in HARMONICS])
        return self.bias.ravel() @ turns, self.scale.ravel() @ turns


class Correction:
    """The map taken off an angle that comes row by row."""

    def __init__(self, known: AngleMap) -> None:
        self._map = known
        self._before: tuple[float, float, float] | None = None
        self._sum = 0.0

    def follow(self, t_s: Floats, theta: Floats, angle: Floats, rate: Floats) -> tuple[Floats, Floats]:
        """Angle (n,) and rate (n,) of the next rows less what the map has of them; θ (n,), t_s (n,) their times."""
        before = self._before or (float(t_s[0]), float(theta[0]), float(angle[0]))
        times, angles = np.insert(t_s, 0, before[0]), np.insert(angle, 0, before[2])
        thetas = 0.5 * np.unwrap(2.0 * np.insert(theta, 0, before[1]))
        self._before = float(times[-1]), float(thetas[-1]), float(angles[-1])
        bias, scale = self._map.at(0.5 * (thetas[1:] + thetas[:-1]))
        gone = self._sum + np.cumsum((bias * np.diff(times) + scale * np.diff(angles)) / (1.0 + scale))
        self._sum = float(gone[-1])
        bias, scale = self._map.at(thetas[1:])
        return angle - gone, (rate - bias) / (1.0 + scale)
