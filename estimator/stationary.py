"""A gain derived once from the dynamics (claims 1, 5, 11, 18 of TW I384198 B1).

The linearised error system of the 13-state observer is not constant: it repeats with the phase of the vibration and
with the orientation of the pattern.  Its stationary Kalman gain is therefore a table over both, filled by running the
Riccati recursion once along the orbit that the controlled device follows; at run time the gain is looked up and
nothing is propagated.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from estimator.errors import ModelError
from estimator.kernel.stationary import gather_gains
from estimator.scaling import Array

if TYPE_CHECKING:
    from estimator.observer import Observer

ANGLES = 32
PHASES = 32
_PRECESSION = 5e-3  # of ω0: fast enough to excite every constant, slow beside the vibration
_TURNS = 12


def stationary_table(observer: "Observer") -> Array:
    """Gains (ANGLES, PHASES, n, 2), scaled, for the observer's variant, noise and memory.

    The step is stretched by 0.7 % so that the phases fill the table even when the sampling is an exact multiple of the
    vibration.  Raises ModelError for a single axis, which has no pattern angle.
    """
    device, settings = observer.device, observer.settings
    if device.axes != 2:
        raise ModelError("a stationary gain is scheduled by the pattern angle and needs two axes; use gain = 'fading'")
    n = observer.p.shape[0]
    half_turn = math.pi / (_PRECESSION * observer.h)
    settle = int(4 * settings.memory * device.sample_rate + half_turn)
    samples = int(max(_TURNS * half_turn, 100 * ANGLES * PHASES))
    total = np.zeros((ANGLES, PHASES, n, 2))
    weight = np.zeros((ANGLES, PHASES))
    gather_gains(
        observer.record, observer.memory, observer.active, observer.walk, observer.prior, observer.p.copy(),
        _PRECESSION, observer.h * 1.007, settle, samples, total, weight,
    )  # fmt: skip
    return np.asarray(total / np.maximum(weight, 1.0)[:, :, None, None])
