"""Golden vectors: the declared device in the loop with its own observer, sample by sample, in codes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.declared_loop import DeclaredLoop
from estimator.observer import Observer


@dataclass(frozen=True)
class Golden:
    """What was sensed and applied (n, 2), what the bench's observer answered (n, 2), in codes; its angle (n,) in rad;
    its state and deviations after the last sample, SI, deviations of what is declared below 0; and samples without
    drive at the start.
    """

    sense: NDArray[np.int32]
    applied: NDArray[np.int32]
    drive: NDArray[np.int32]
    angle: NDArray[np.float64]
    state: NDArray[np.float64]
    deviation: NDArray[np.float64]
    quiet: int


def golden(observer: Observer, samples: int, quiet: int) -> Golden:
    """Close the loop about the device as declared, turning at 1 rad/s, for so many samples: the first without drive.

    The device has none of the effects: its signal is what the vectors are made from, not what they test.
    """
    loop = DeclaredLoop(observer)
    sense, applied, drive = (np.zeros((samples, 2), np.int32) for _ in range(3))
    angle = np.zeros(samples)
    for m in range(samples):
        sense[m], applied[m] = loop.sample()
        observer.enable_control(m >= quiet)
        drive[m] = observer.tick(*map(float, sense[m]), *map(float, applied[m]))
        loop.answer((int(drive[m, 0]), int(drive[m, 1])))
        angle[m] = observer.newest["angle"]
    state, deviation = observer.reading()
    told = np.full(len(state), -1.0)
    told[observer.estimated_index] = np.array(deviation)[observer.estimated_index]
    return Golden(sense, applied, drive, angle, np.array(state), told, quiet)
