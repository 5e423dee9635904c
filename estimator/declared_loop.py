"""The declared device at the other end of an observer's loop, in codes: linear, as the data sheet has it, turning."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from estimator.observer import Observer

RATE_RAD_S = 1.0
_SEED = 20
_LIMIT = 1 << 23

Codes = NDArray[np.int32]


class DeclaredLoop:
    """The device of `observer`, which turns at 1 rad/s and has none of the effects, with its noise and its latency."""

    def __init__(self, observer: Observer) -> None:
        device = observer.device
        self._step = _transition(observer)
        self._gain, self._quantum = np.array(device.sense_gain), observer.sense_quantum
        self._force = observer.drive_quantum
        self._noise, self._random = device.noise, np.random.default_rng(_SEED)
        self._motion = np.array([device.amplitude, 0.0, 0.0, 0.0])
        self._queue = [(0, 0)] * (observer.latency + 1)  # the first one acted before the first sample

    def sample(self) -> tuple[Codes, Codes]:
        """The next sample: codes sensed (2,) and those of the drive that acted up to it (2,)."""
        applied = np.array(self._queue.pop(0), np.int32)
        self._motion = self._step @ np.concatenate([self._motion, applied * self._force])
        volts = self._gain * self._motion[[0, 2]] + self._random.normal(scale=self._noise)
        return np.clip(np.rint(volts / self._quantum), -_LIMIT, _LIMIT - 1).astype(np.int32), applied

    def answer(self, codes: tuple[int, int]) -> None:
        """The drive that the sample was answered with."""
        self._queue.append(codes)


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
