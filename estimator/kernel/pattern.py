"""The vibration pattern: orientation, energy and angular momentum of the ellipse (11), and their corrected form.

With velocities measured in the rotating board frame, (11) ripples at twice the vibration by W/2ω.  Evaluated with
ẋ − W y, ẏ + W x and the stiffness of the frame in which the pattern rests it is exact; W = Ω̂ + Ωv.
"""

import math

from estimator.kernel.compiled import compiled
from estimator.kernel.layout import Floats


@compiled
def pattern(s: Floats, k: float, w: float, rate: float) -> tuple[float, float, float]:
    """(2θ, energy, angular momentum) of state s = (x, ẋ, y, ẏ) under target stiffness k and total rotation w.

    The real rotation carries its own centrifugal term, the virtual one does not: the stiffness is k + w² − rate².
    With w = rate = 0 this is formula (11) of the source (Friedland & Hutton 1978).
    """
    x = s[0]
    y = s[2]
    vx = s[1] - w * y
    vy = s[3] + w * x
    ke = k + w * w - rate * rate
    double = math.atan2(2.0 * (ke * x * y + vx * vy), ke * (x * x - y * y) + (vx * vx - vy * vy))
    energy = 0.5 * (ke * (x * x + y * y) + vx * vx + vy * vy)
    momentum = x * vy - y * vx
    return double, energy, momentum


@compiled
def phase_and_angle(s: Floats, k: float) -> tuple[float, float]:
    """(θ in [−π/2, π/2), phase in [−π, π)) of the motion along the pattern's long axis, a cos(phase)."""
    double, _, _ = pattern(s, k, 0.0, 0.0)
    theta = 0.5 * double
    position = s[0] * math.cos(theta) + s[2] * math.sin(theta)
    velocity = s[1] * math.cos(theta) + s[3] * math.sin(theta)
    return theta, math.atan2(-velocity, position * math.sqrt(k))


@compiled
def unwrap_half_turns(double: float, before: float) -> float:
    """θ nearest to `before` among double/2 + nπ: the ellipse is the same after half a turn."""
    theta = 0.5 * double
    return theta + math.pi * math.floor((before - theta) / math.pi + 0.5)
