"""The observer's own model in closed loop with itself: what an experiment's record would look like."""

import ctypes
from typing import NamedTuple

from estimator.core.arguments import Arguments
from estimator.core.following import Observing
from estimator.core.layout import Floats
from estimator.core.library import LIBRARY

_EXPERIMENT = Arguments("experiment.h", "Experiment")
MOST_LATE = 63


class Plan(NamedTuple):
    """What an experiment does: rotation rate and the controller's target stiffness (n,) at each sample, noise (n, 2)
    added to what is sensed; late: samples, 0 to MOST_LATE, by which the drive acts later than the record says.
    """

    rates: Floats
    stiffness: Floats
    noise: Floats
    late: float = 0.0


def experiment_block(observer: Observing, truth: Floats, plan: Plan, sensed: Floats, drive: Floats) -> None:
    """n samples of the loop: a truth that begins as (states + constants,) moves under the drive that the observer asks
    for, which is left at the last target.

    sensed and drive (n, 2) receive the record, drive[m] acting over the interval that ends at m.
    """
    LIBRARY.gyro_experiment_block(
        ctypes.c_void_p(observer.core),
        _EXPERIMENT(
            n=len(sensed), settings=observer.arrays.settings, **plan._asdict(), truth=truth.copy(), sensed=sensed,
            drive=drive,
        ),
    )  # fmt: skip
