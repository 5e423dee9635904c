"""Free runs of a ring-down of a gyro that turns, beside a line on its channels."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.record import Record
from estimator.settings import Device, ObserverSettings
from estimator.trace import prediction
from estimator.trace.problem import Problem

SAMPLE_RATE, N, RATE = 96_000.0, 16_000, -0.62
OMEGA = 2.0 * np.pi * 2160.0
DEVICE = Device(
    sample_rate=SAMPLE_RATE,
    stiffness=(OMEGA**2, OMEGA**2, 0.0),
    damping=(2.7, 2.7, 0.0),
    amplitude=5e-6,
    sense_gain=(4e4, 4e4),
    noise=(5e-4, 5e-4),
)


def ring_down(rate: float) -> Record:
    """Of a gyro that turns at a constant rate: a linear system, from one sample to the next by its exponential."""
    coriolis = np.array([[0.0, 1.0], [-1.0, 0.0]])
    stiffness = OMEGA**2 * np.array([[0.976, -7e-4], [-7e-4, 1.006]])
    flow = np.block(
        [
            [np.zeros((2, 2)), np.eye(2)],
            [-stiffness - rate**2 * coriolis @ coriolis, -2.7 * np.eye(2) + 2.0 * rate * coriolis],
        ]
    )
    step = expm(flow / SAMPLE_RATE)
    states = np.zeros((N, 4))
    states[0] = DEVICE.amplitude * np.array([0.8, 0.6, 0.0, 0.0])
    for tick in range(1, N):
        states[tick] = step @ states[tick - 1]
    noise = 5e-4 * np.random.default_rng(4).standard_normal((N, 2))
    return Record(4e4 * states[:, :2] + noise, np.zeros((N, 2, 1)), np.full(N, 1.0 / SAMPLE_RATE))


LINE = 2.0 * np.pi * 3000.0
VOLTS = {"lcx": 0.02, "lsx": -0.01, "lcy": 0.005, "lsy": 0.015}
HUM = {"interference": {"omega": LINE, **{name: volts / 4e4 for name, volts in VOLTS.items()}}}


def hummed(record: Record) -> Record:
    """With a line on both sense channels, of 40 times the noise; time counts from one step before the first sample."""
    time = np.cumsum(record.step)
    line = np.column_stack([np.cos(LINE * time), np.sin(LINE * time)])
    return replace(record, sense=record.sense + line @ np.reshape(list(VOLTS.values()), (2, 2)).T)


@pytest.mark.moderate
def test_free_runs_of_a_long_record_lie_around_the_split(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reach, split = 4000, 9000
    monkeypatch.setattr(prediction, "READ", reach)
    settings = ObserverSettings(memory=0.005, initial={"rate": RATE})
    errors = prediction.free_run_error(Problem(hummed(ring_down(RATE)), DEVICE, settings).carrying(HUM), split)
    there = np.flatnonzero(np.all(np.isfinite(errors), axis=1))
    assert split - reach < there[0] < split < there[-1] < split + reach
    assert np.sqrt(np.nanmean(errors**2)) < 0.01  # the line alone is 0.016
