"""What the calibration does to the reported angle: the standard uncertainty of each constant, carried to the angle in
closed form.

With a phasor q of the motion the control law asks for u = (K − k + iω(D + 2Ωv J)) q.  A drive that does E u more than
told, with E = diag(hx − iωτx, hy − iωτy) or, off the diagonal, mx and my, and a sense chain that shows (1 + S) q add to
the equation of motion, as the observer reads it,

    E (K − k + iω(D + 2Ωv J)) q          and          ((K − k + iωD) S + 2iωΩv S J + 2iωΩ [S, J]) q

The symmetric parts look like stiffness and damping, which the observer estimates; the antisymmetric part of what goes
with the velocity, A = 2 δΩ J, looks like a rotation, and is taken for one:

    hx, hy    δΩ = ½ (hx + hy) Ωv + ¼ (hx − hy) dxy          gy        δΩ = ½ gy Ωv + ¼ gy dxy
    mx, my    δΩ = ¼ (mx dyy − my dxx)                       ex, ey    δΩ = ¼ (ex dxx − ey dyy)
    τx, τy    δΩ = − ¼ (τx − τy) kxy of the drive            τx, τy    δΩ = + ¼ (τx − τy) kxy of the sense channels

The map of a sense interface that reads the amplitude of an axis wrong, gx or gy, acts as gy does.
gy and ex, ey also show the ellipse at the wrong angle, by ½ gy sin 2θ and ½ (ex + ey) cos 2θ.  A board's clock that is
fast by δ makes each of its forces act as if it were smaller by 2δ, and nothing else: an angle has no unit of time.
The derivation stands in docs/explanation.md; each line is held against the emulator.
"""

from dataclasses import dataclass, fields
from typing import Any

Number = Any  # a float, or an array (n,)


@dataclass(frozen=True)
class Calibration:
    """Standard uncertainties of the constants: relative, or in seconds for the delays.  Of two axes each by itself."""

    drive_gain: float = 0.0
    sense_gain_ratio: float = 0.0
    drive_misalignment: float = 0.0
    sense_cross_coupling: float = 0.0
    drive_delay: float = 0.0
    sense_delay: float = 0.0
    clock: float = 0.0
    angular_gain: float = 0.0
    sense_interface: float = 0.0


CONSTANTS = tuple(field.name for field in fields(Calibration))


@dataclass(frozen=True)
class SinceZero:
    """What happened since the reference instant: numbers, or arrays of one shape.

    seconds; rotation [rad] of the board as reported; forced [rad]: rotation of the board that was taken off for forces,
    virtual rotation above all; stiffness_xy [1/s²] and damping (xx, yy, xy) [1/s] that the control law cancels;
    angular_gain: rotation of the pattern over that of the board.
    """

    seconds: Number
    rotation: Number
    forced: Number
    stiffness_xy: Number
    damping: tuple[Number, Number, Number]
    angular_gain: float = 1.0


def variances(calibration: Calibration, course: SinceZero) -> dict[str, Number]:
    """Variance [rad²] of the reported angle by each constant."""
    return {name: square * getattr(calibration, name) ** 2 for name, square in sensitivities(course).items()}


def sensitivities(course: SinceZero) -> dict[str, Number]:
    """Square of what one unit of each constant does to the angle: of its two axes together where it has two."""
    seconds, forced, per = course.seconds, course.forced, 1.0 / course.angular_gain
    xx, yy, xy = course.damping
    turned = (0.5 * forced) ** 2
    apart = (0.25 * per * seconds * xy) ** 2
    dragged = (0.25 * per * seconds) ** 2 * (xx**2 + yy**2)
    late = 2.0 * (0.25 * per * seconds * course.stiffness_xy) ** 2
    # The ellipse is shown at a wrong angle at both ends, of which neither is known beforehand: rms of a difference.
    begun = 1.0 * (seconds > 0.0)
    shown = (0.5 * per) ** 2 * begun
    return {
        "drive_gain": 2.0 * (turned + apart),
        "sense_gain_ratio": turned + apart + shown,
        "drive_misalignment": dragged,
        "sense_cross_coupling": dragged + 2.0 * shown,
        "drive_delay": late,
        "sense_delay": late,
        "clock": 4.0 * forced**2,
        "angular_gain": course.rotation**2,
        "sense_interface": 2.0 * (turned + apart + shown),
    }
