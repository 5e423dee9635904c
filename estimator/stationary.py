"""A gain derived once from the dynamics (claims 1, 5, 11, 18 of TW I384198 B1).

The linearised error system of the 13-state observer is not constant: it repeats with the phase of the vibration and
with the orientation of the pattern.  Its stationary Kalman gain is therefore a table over both, filled by running the
Riccati recursion once along the orbit of the controlled device; at run time the gain is looked up and nothing is
propagated.

The motion on that orbit is that of an ideal oscillator, but its *error* swings at the device's own frequencies, because
the observer takes the drive for what it is and not for what the control makes of it.  Hence the recursion runs with the
declared constants of the device, held on the orbit by the force that does so; and as they are not known exactly, the
motion is corrected faster than its error can turn in a way that the table does not predict.  The memory of the
constants stays what it is.
"""

import math

import numpy as np

from estimator.core.filter import Filter
from estimator.core.structures import Arrays
from estimator.errors import ModelError
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings

ANGLES = 32
PHASES = 32
_PRECESSION = 5e-3  # of ω0: fast enough to excite every constant, slow beside the vibration
_TURNS = 12


def stationary_table(arrays: Arrays, device: Device, settings: ObserverSettings, h: float) -> Array:
    """Gains (ANGLES, PHASES, n, 2), scaled, for an observer's variant, initial value, noise and memory; h: scaled time
    of a sample.

    The step is stretched by 0.7 % so that the phases fill the table even when the sampling is an exact multiple of the
    vibration.  Raises ModelError for a single axis, which has no pattern angle.
    """
    if device.axes != 2:
        raise ModelError("a stationary gain is scheduled by the pattern angle and needs two axes; use gain = 'fading'")
    n = arrays.p.shape[0]
    half_turn = math.pi / (_PRECESSION * h)
    settle = int(4 * settings.memory * device.sample_rate + half_turn)
    samples = int(max(_TURNS * half_turn, 100 * ANGLES * PHASES))
    total = np.zeros((ANGLES, PHASES, n, 2))
    weight = np.zeros((ANGLES, PHASES))
    record = arrays.settings.copy()
    record["force_noise"] += unforeseen(arrays, settings, h)
    own = arrays._replace(
        table=total, settings=record, p=arrays.p.copy(), x=arrays.x.copy(), memory=arrays.memory.copy()
    )
    Filter(own).gather(total, weight, rotation=_PRECESSION, h=h * 1.007, settle=settle, samples=samples)
    return np.asarray(total / np.maximum(weight, 1.0)[:, :, None, None])


def unforeseen(arrays: Arrays, settings: ObserverSettings, h: float) -> Array:
    """Force noise (axes,), scaled, on top of the declared one: for the table only, not for what is reported.

    A relative uncertainty s of the stiffness is one of s/2 in the frequencies, and of s at two standard deviations: in
    a memory of the motion longer than 1/s (scaled time) the table would take the error's phase for another.  An
    amplitude that is a random walk of intensity q, seen with variance r by samples h apart, is followed with bandwidth
    √(q / 2 r h); a force of intensity f makes it one of f/2.  So f = 4 s² r h gives the motion a memory of 1/s.
    """
    variance = arrays.settings["noise"][0] + arrays.settings["ignored"][0]
    return np.asarray(4.0 * settings.spread.stiffness**2 * variance * h)
