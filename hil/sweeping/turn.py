"""The bias that depends on where the pattern is: what is asked of a whole-angle gyro over a full turn.

The error of the angle, less what the rate's mean bias makes of it, is b(θ) summed up along the way: the bias b depends
on the pattern angle θ, and what a device lacks shows as its harmonics (delays and damping at 2θ, a cubic spring at 4θ).
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.records.estimates import Estimates
from hil.records.truth import Truth
from hil.scoring.score import Window, angle_error_rad, pattern_angle_rad

Floats = npt.NDArray[np.float64]
_HARMONICS = 2  # of 2θ: 2θ and 4θ
_CELLS = 64  # of the window, over each of which the error grows by a sum of its own
_TURN = 2.0 * np.pi
_STATES = ("x_m", "vx_mps", "y_m", "vy_mps")


class Turn(NamedTuple):
    """Bias of the angle [rad/s], mean over a turn of the pattern, and from its least to its largest value."""

    mean: float
    span: float


def over_a_turn(estimates: Estimates, truth: Truth, window: Window, stiffness_per_s2: float) -> Turn | None:
    """Of a run's scored window.  None where the pattern makes no full turn in it, or there is no angle."""
    error = angle_error_rad(estimates, truth, window)
    if error is None or not all(name in truth.columns for name in _STATES):
        return None
    state = np.stack([truth[name][window.true] for name in _STATES])
    doubled = 2.0 * pattern_angle_rad(state, stiffness_per_s2, np.zeros(window.t_s.size))
    return bias_over_a_turn(window.t_s, np.unwrap(doubled) / 2.0, error)


def bias_over_a_turn(t_s: Floats, pattern_rad: Floats, error_rad: Floats) -> Turn | None:
    """From times, unwrapped pattern angles and errors of the angle (n,), by least squares of the error's growth over
    short parts: an angle's error is much like a random walk, whose growths are independent and whose values are not.
    """
    if t_s.size < 2 * _CELLS or np.ptp(pattern_rad) < _TURN:
        return None
    phases = 2.0 * np.arange(1, _HARMONICS + 1) * pattern_rad[:, None]
    bias = np.hstack([np.ones((t_s.size, 1)), np.cos(phases), np.sin(phases)])
    middle = 0.5 * (bias[1:] + bias[:-1]) * np.diff(t_s)[:, None]
    summed = np.vstack([np.zeros((1, bias.shape[1])), np.cumsum(middle, axis=0)])
    ends = np.linspace(0, t_s.size - 1, _CELLS + 1).astype(int)
    found = np.linalg.lstsq(np.diff(summed[ends], axis=0), np.diff(error_rad[ends]), rcond=None)[0]
    round_ = 2.0 * np.arange(1, _HARMONICS + 1) * np.linspace(0.0, np.pi, 361)[:, None]
    course = np.hstack([np.cos(round_), np.sin(round_)]) @ found[1:]
    return Turn(float(found[0]), float(np.ptp(course)))
