"""The declared device at the other end of an observer's loop, in codes: a linear oscillator, as the data sheet has it,
that turns, behind its sense interface.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from estimator.observer import Observer
from estimator.settings import Device, Sensed

RATE_RAD_S = 1.0
_SEED = 20
_LIMIT = 1 << 23

Codes = NDArray[np.int32]


class DeclaredLoop:
    """The device of `observer`, which turns at 1 rad/s and has none of the effects, with its interface, its noise and
    its latency.
    """

    def __init__(self, observer: Observer) -> None:
        device = observer.device
        self._shown = _shown(device)
        self._step = _transition(device)
        self._quantum = observer.sense_quantum
        self._force = observer.drive_quantum
        self._noise, self._random = device.noise, np.random.default_rng(_SEED)
        self._motion = np.zeros(6)
        self._motion[0] = device.amplitude
        self._queue = [(0, 0)] * (observer.latency + 1)  # the first one acted before the first sample

    def sample(self) -> tuple[Codes, Codes]:
        """The next sample: codes sensed (2,) and those of the drive that acted up to it (2,)."""
        applied = np.array(self._queue.pop(0), np.int32)
        self._motion = self._step @ np.concatenate([self._motion, applied * self._force])
        volts = self._shown(self._motion) + self._random.normal(scale=self._noise)
        return np.clip(np.rint(volts / self._quantum), -_LIMIT, _LIMIT - 1).astype(np.int32), applied

    def answer(self, codes: tuple[int, int]) -> None:
        """The drive that the sample was answered with."""
        self._queue.append(codes)


def _corner(device: Device) -> NDArray[np.float64] | None:
    """Of the layers of both axes, rad/s; None where a channel shows the motion itself."""
    interface = device.interface
    return np.array(interface.constants) if interface and interface.kind == "piezoelectric" else None


def _shown(device: Device) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """From x, vx, y, vy and the current of both layers to volts (2,) without noise."""
    gain, interface = np.array(device.sense_gain), device.interface
    if Sensed.VELOCITY in device.sensed:
        columns = [1, 3] if _corner(device) is None else [4, 5]
        return lambda motion: gain / math.sqrt(device.target) * motion[columns]
    if interface is None or interface.kind == "piezoresistive":  # as warm as at its first reading
        return lambda motion: gain * motion[[0, 2]]
    return lambda motion: gain * interface.channels(*motion[[0, 2]])


def _transition(device: Device) -> NDArray[np.float64]:
    """What a sample interval does to (x, vx, y, vy, a current for each axis) under a drive that is held: (6, 8)."""
    (kxx, kyy, kxy), (dxx, dyy, dxy) = device.stiffness, device.damping
    w, corner = RATE_RAD_S, _corner(device)
    motion = np.zeros((8, 8))
    motion[0, 1] = motion[2, 3] = 1.0
    motion[1, :4], motion[1, 6] = [w * w - kxx, -dxx, -kxy, 2.0 * w - dxy], 1.0
    motion[3, :4], motion[3, 7] = [-kxy, -2.0 * w - dxy, w * w - kyy, -dyy], 1.0
    if corner is not None:
        motion[[4, 5], [1, 3]], motion[[4, 5], [4, 5]] = corner, -corner
    return np.asarray(expm(motion / device.sample_rate)[:6])
