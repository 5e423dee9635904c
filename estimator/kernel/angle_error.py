"""What is not known of the reported angle: its variance, and its covariance with the state, from sample to sample.

The angle is φ̂ = −(θ̂ − θ0) less what forces turned the pattern by, and both are estimates.  In a prediction it moves by
Ω̂ h, in a correction by what that turns θ̂ by, −g·K ν with g = ∂θ/∂s: so its error φ̃ = φ̂ − φ obeys

    φ̃ ← φ̃ + Ω̃ h,          s̃ ← F s̃ + w
    φ̃ ← φ̃ + g·K (H s̃ − n), s̃ ← s̃ − K (H s̃ − n)

whatever the gain K is, and its covariance follows in Joseph's form beside C (`estimator.kernel.observer`).  What forces
turned the pattern by is in it through the constants it was computed with.  From the reference instant on, the angle is
counted from its value there, which is then exact by definition.
"""

from estimator.kernel.compiled import compiled, inlined
from estimator.kernel.layout import Floats, Record


@inlined
def note_gradient(settings: Record, memory: Record, s: Floats) -> None:
    """memory.gradient ← ∂θ/∂(x, ẋ, y, ẏ) of formula (11) at s; 0 for a mass at rest, which has no angle, and in open
    loop, where no correction of the state turns the integrated rate.
    """
    k = settings.stiffness
    x, vx, y, vy = s[0], s[1], s[2], s[3]
    sine = 2.0 * (k * x * y + vx * vy)
    cosine = k * (x * x - y * y) + vx * vx - vy * vy
    square = sine * sine + cosine * cosine
    share = 1.0 / square if square > 0.0 and settings.open_loop == 0 else 0.0
    memory.gradient[0] = share * k * (cosine * y - sine * x)
    memory.gradient[1] = share * (cosine * vy - sine * vx)
    memory.gradient[2] = share * k * (cosine * x + sine * y)
    memory.gradient[3] = share * (cosine * vx + sine * vy)


@inlined
def refer_angle(settings: Record, memory: Record) -> bool:
    """Whether this is the reference instant."""
    if memory.referred == 1 or memory.time < settings.reference:
        return False
    memory.referred = 1
    return True


@compiled
def predict_angle(settings: Record, memory: Record, c: Floats, h: float) -> None:
    """φ̃ ← φ̃ + Ω̃ h, before the states move; c (n, n) is their covariance."""
    rate = settings.rate_row
    cross = memory.angle_cross
    memory.angle_variance += h * (2.0 * cross[rate] + h * c[rate, rate])
    for i in range(c.shape[0]):
        cross[i] += h * c[i, rate]


@compiled
def move_angle(memory: Record, g: Floats) -> None:
    """The states' part of the cross-covariance by the flow g (n, states)."""
    cross = memory.angle_cross
    a0, a1, a2, a3 = 0.0, 0.0, 0.0, 0.0
    for j in range(g.shape[0]):
        a0 += g[j, 0] * cross[j]
        a1 += g[j, 1] * cross[j]
        a2 += g[j, 2] * cross[j]
        a3 += g[j, 3] * cross[j]
    cross[0], cross[1], cross[2], cross[3] = a0, a1, a2, a3


@compiled
def correct_angle(
    memory: Record, c: Floats, jacobian: Floats, noise: Floats, channels: int, gain: Floats, scratch: Floats
) -> None:
    """A correction with gain (n, channels), c (n, n) as it was before; scratch (4, n)."""
    n = c.shape[0]
    cross = memory.angle_cross
    for a in range(channels):
        for i in range(n):
            scratch[a, i] = 0.0
        for j in range(n):
            w = jacobian[a, j]
            if w != 0.0:
                for i in range(n):
                    scratch[a, i] += w * c[j, i]
    for a in range(channels):  # one after the other, with what they share in the second
        turn = 0.0
        for i in range(4):
            turn -= memory.gradient[i] * gain[i, a]
        seen = 0.0
        for j in range(n):
            seen += jacobian[a, j] * cross[j]
        scratch[2, a] = turn
        scratch[3, a] = seen
    for a in range(channels):
        memory.angle_variance -= 2.0 * scratch[2, a] * scratch[3, a]
        pushed = 0.0  # Σ S Kφ
        for b in range(channels):
            s = noise[a] if a == b else 0.0
            for j in range(n):
                s += jacobian[b, j] * scratch[a, j]
            pushed += s * scratch[2, b]
        memory.angle_variance += pushed * scratch[2, a]
        for i in range(n):
            cross[i] += (pushed - scratch[3, a]) * gain[i, a] - scratch[2, a] * scratch[a, i]


@compiled
def recall_angle(memory: Record, c: Floats, row: int, gain: Floats, noise: float) -> None:
    """A direct measurement of entry `row` with gain (n,), c (n, n) as it was before."""
    cross = memory.angle_cross
    turn = 0.0
    for i in range(4):
        turn -= memory.gradient[i] * gain[i]
    seen = cross[row]
    pushed = (c[row, row] + noise) * turn
    memory.angle_variance += (pushed - 2.0 * seen) * turn
    for i in range(c.shape[0]):
        cross[i] += (pushed - seen) * gain[i] - turn * c[row, i]


@inlined
def turn_angle(memory: Record, h: Floats, y: Floats, share: float) -> None:
    """A measurement h (n,) taken in by the Kalman gain y/√S, y = C h/√S; share: 1/√S.

    With that gain what `correct_angle` says of the covariance comes down to −(h·c) y/√S, c the covariance before.
    """
    cross = memory.angle_cross
    turn = 0.0
    for i in range(4):
        turn -= memory.gradient[i] * y[i]
    seen = 0.0
    for j in range(h.shape[0]):
        seen += h[j] * cross[j]
    seen *= share
    memory.angle_variance += (turn - 2.0 * seen) * turn
    for i in range(h.shape[0]):
        cross[i] -= seen * y[i]
