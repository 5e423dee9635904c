"""Golden vectors: the declared device in the loop with its own observer, sample by sample, in codes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from estimator.observer import Observer

RATE_RAD_S = 1.0
_SEED = 20


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

    The device is linear and has none of the effects: its signal is what the vectors are made from, not what they test.
    """
    device, latency = observer.device, observer.latency
    step = _transition(observer)
    quantum, limit = observer.sense_quantum, 1 << 23
    noise = np.random.default_rng(_SEED).normal(scale=device.noise, size=(samples, 2))
    gain = np.array(device.sense_gain)
    motion = np.array([device.amplitude, 0.0, 0.0, 0.0])
    queue = [(0, 0)] * (latency + 1)  # the first one acted before the first sample
    sense, applied, drive = (np.zeros((samples, 2), np.int32) for _ in range(3))
    angle = np.zeros(samples)
    for m in range(samples):
        applied[m] = queue.pop(0)
        motion = step @ np.concatenate([motion, applied[m] * observer.drive_quantum])
        volts = gain * motion[[0, 2]] + noise[m]
        sense[m] = np.clip(np.rint(volts / quantum), -limit, limit - 1)
        observer.enable_control(m >= quiet)
        drive[m] = observer.tick(*map(float, sense[m]), *map(float, applied[m]))
        queue.append((int(drive[m, 0]), int(drive[m, 1])))
        angle[m] = observer.newest["angle"]
    state, deviation = observer.reading()
    told = np.full(len(state), -1.0)
    told[observer.estimated_index] = np.array(deviation)[observer.estimated_index]
    return Golden(sense, applied, drive, angle, np.array(state), told, quiet)


def _transition(observer: Observer) -> NDArray[np.float64]:
    """What a sample interval does to (x, vx, y, vy) under a drive that is held: (4, 6)."""
    device = observer.device
    (kxx, kyy, kxy), (dxx, dyy, dxy) = device.stiffness, device.damping
    w = RATE_RAD_S
    motion = np.zeros((6, 6))
    motion[0, 1] = motion[2, 3] = 1.0
    motion[1] = [w * w - kxx, -dxx, -kxy, 2.0 * w - dxy, 1.0, 0.0]
    motion[3] = [-kxy, -2.0 * w - dxy, w * w - kyy, -dyy, 0.0, 1.0]
    return np.asarray(expm(motion / device.sample_rate)[:4])
