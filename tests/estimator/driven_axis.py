"""A driven single axis, and how its state is written down."""

from typing import Any

import numpy as np

from estimator.observer import Observer
from estimator.settings import Device, Gain, ObserverSettings, Spread

RATE, N = 600.0, 500
DEVICE = Device(sample_rate=RATE, stiffness=(1.9e5,), damping=(40.0,), amplitude=0.1, sense_gain=(2.0,), noise=(1e-4,))
SETTINGS = ObserverSettings(gain=Gain.EKF, spread=Spread(offset=0.01, stiffness=0.05, damping=0.5, drive_gain=0.1))
DRIVE = 1.5e4 * np.random.default_rng(3).standard_normal((N, 1))


def state_of(observer: Observer, **values: float) -> Any:
    state = observer.state.copy()
    for name, value in values.items():
        state[observer.names.index(name)] = value
    return state
