"""The vibration ellipse by one complex number.

With z = x + iy the motion is two counter-rotating circles a e^{iωt} + b e^{-iωt}, and the ellipse lies along
θ = ½ arg(ab) = ½ arg(k z² + ż²): formula (11) of TW I384198 B1.  Seen in the frame in which the pattern rests, ż
becomes ż + iWz and k becomes k + W² − Ω² (docs/explanation.md).
"""

import math
from dataclasses import dataclass

import numpy as np

from estimator.scaling import Array


def pattern(s: Array, k: float, w: Array | float, rate: Array | float) -> tuple[Array, Array, Array]:
    """2θ [rad], energy and angular momentum, each (n,), of states s (n, 4); w is the total rotation Ω + Ωv, rate is
    Ω.
    """
    z = s[:, 0] + 1j * s[:, 2]
    dz = s[:, 1] + 1j * s[:, 3] + 1j * w * z
    stiffness = k + np.square(w) - np.square(rate)
    energy = 0.5 * (stiffness * np.abs(z) ** 2 + np.abs(dz) ** 2)
    return np.angle(stiffness * z**2 + dz**2), energy, np.imag(np.conj(z) * dz)


def pattern_gradient(s: Array, k: float, w: float, rate: float) -> Array:
    """Derivative (5,) of θ by x, ẋ, y, ẏ and the rate Ω at one state s (4,), Ωv held: ∂θ = ½ Im(∂G/G), G = k z² +
    ż².
    """
    z = complex(s[0], s[2])
    dz = complex(s[1], s[3]) + 1j * w * z
    stiffness = k + w * w - rate * rate
    position = 2.0 * stiffness * z + 2.0 * dz * 1j * w  # ∂G for a unit of z
    velocity = 2.0 * dz
    turn = 2.0 * (w - rate) * z**2 + 2.0 * dz * 1j * z
    steps = np.array([position, velocity, 1j * position, 1j * velocity, turn])
    return np.asarray(0.5 * np.imag(steps / (stiffness * z**2 + dz**2)))


@dataclass
class PatternAngle:
    """An angle known modulo π, unwrapped from block to block."""

    start: float = math.nan
    last: float = math.nan

    def unwrap(self, double: Array) -> tuple[Array, Array]:
        """From 2θ (n,) the unwrapped θ of the sample before (the first has none but its own) and of each sample,
        (n,).
        """
        theta = 0.5 * double
        if math.isnan(self.start):
            self.start = self.last = float(theta[0])
        theta = np.unwrap(np.concatenate([[self.last], theta]), period=np.pi)
        self.last = float(theta[-1])
        return theta[:-1], theta[1:]
