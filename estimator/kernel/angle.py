"""The rotation angle from sample to sample: what the pattern shows, less what forces turned it by."""

import math

from estimator.kernel.compiled import compiled
from estimator.kernel.layout import RATE, Floats, Record
from estimator.kernel.pattern import pattern, unwrap_half_turns


@compiled
def note_forced_rotation(settings: Record, memory: Record, x: Floats, h: float) -> None:
    """Add to memory.forced what the model says the forces, rather than the rotation of the board, turned the pattern
    by.

    x is the prediction from the last estimate through the drive that really acted.  In an ideal oscillator it would
    have turned by −Ω̂ h; the rest is virtual rotation, dither, holds, rounding, a drive held over a late answer.
    """
    if memory.started == 1:
        double, _, _ = pattern(x, settings.stiffness, memory.rotation, memory.rate)
        memory.forced += unwrap_half_turns(double, memory.theta) - memory.theta + memory.rate * h


@compiled
def read_angle(settings: Record, memory: Record, x: Floats, h: float, row: Record) -> None:
    """Angle, energy and quadrature of the estimate at the end of h into an output row; unwraps and counts turns.  All
    rotations go out as the board's: divided by the angular gain, κ.

    The pattern lags the board (docs/explanation.md): κφ = −(θ − θ0) plus what forces turned the pattern by.  Taking off
    the virtual rotation alone, as an ideal control would allow, is kept as angle_pattern.
    """
    rate = x[settings.states + RATE]
    memory.rate_integral += rate * h
    memory.virtual_integral += memory.virtual_applied * h
    w = rate + memory.virtual_applied
    double, energy, momentum = pattern(x, settings.stiffness, w, rate)
    plain, _, _ = pattern(x, settings.stiffness, 0.0, 0.0)
    if memory.started == 0:
        memory.started = 1
        memory.theta = 0.5 * double
        memory.theta_zero = memory.theta
        memory.theta_plain = unwrap_half_turns(plain, memory.theta)
        memory.theta_plain_zero = memory.theta_plain
        memory.virtual_integral = 0.0
        memory.rate_integral = 0.0
    else:
        memory.theta = unwrap_half_turns(double, memory.theta)
        memory.theta_plain = unwrap_half_turns(plain, memory.theta_plain)
    memory.rotation = w
    memory.rate = rate
    turns = 1.0 / settings.angular_gain
    row.angle = turns * (memory.theta_zero - memory.theta + memory.forced)
    if settings.open_loop == 1:
        row.angle = turns * memory.rate_integral
    row.angle_forced = -turns * memory.forced
    row.angle_pattern = turns * (memory.theta_zero - memory.theta - memory.virtual_integral)
    row.angle_plain = turns * (memory.theta_plain_zero - memory.theta_plain - memory.virtual_integral)
    row.angle_rate_integral = turns * memory.rate_integral
    row.energy_ratio = energy / settings.energy
    row.quadrature_ratio = math.sqrt(settings.stiffness) * momentum / energy if energy > 0.0 else 0.0
