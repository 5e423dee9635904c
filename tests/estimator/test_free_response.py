"""Free responses of two axes that go by the free run (docs/reference/trace.md)."""

import numpy as np

from estimator.record import Record
from estimator.settings import Device, ObserverSettings, ProcessNoise, Spread
from estimator.trace.free_response import loses_what_a_free_run_follows
from estimator.trace.problem import Problem

RATE, N = 4000.0, 4_000
OMEGA = 2.0 * np.pi * 200.0
DEVICE = Device(
    sample_rate=RATE, stiffness=(OMEGA**2, OMEGA**2, 0.0), damping=(0.8, 0.8, 0.0), amplitude=1e-4,
    sense_gain=(890.0, 890.0), noise=(1e-4, 1e-4),
)  # fmt: skip
DIVERGES = ObserverSettings(
    memory=0.006,
    spread=Spread(rate=1000.0, stiffness=1.0, damping=1e6),
    process_noise=ProcessNoise(force=1e-30, rate=0.0),
)
"""As of tests/cli/test_diverged.py: beyond all numbers within 0.2 s."""


def test_an_observer_without_a_single_innovation_does_not_lose_a_motion() -> None:
    """It diverges, and tracing says so; a free run of a record so far from its declaration is no way out."""
    t = np.arange(1, N + 1) / RATE
    sense = 0.089 * np.exp(-0.4 * t)[:, None] * np.stack([np.cos(OMEGA * t), np.sin(OMEGA * t)], axis=1)
    sense += np.random.default_rng(1).normal(0.0, 1e-4, sense.shape)
    record = Record(sense, np.zeros((N, 2, 1)), np.full(N, 1.0 / RATE))
    problem = Problem(record, DEVICE, DIVERGES)
    with np.errstate(all="ignore"):
        assert not loses_what_a_free_run_follows(problem)
