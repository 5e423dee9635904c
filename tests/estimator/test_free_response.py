"""Free responses of two axes that go by the free run (docs/reference/trace.md)."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings, ProcessNoise, Spread
from estimator.trace import free_response
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


FIRST, SAMPLES = 3, 12


def free(
    monkeypatch: pytest.MonkeyPatch, missed: Array, residual: Array | None, drive: float = 0.0
) -> tuple[bool, SimpleNamespace]:
    """Of an observer that misses so much, and a free run that errs by so much, or that there is not; what was asked."""
    asked = SimpleNamespace(settings=None, fitted=None, scored=None)

    def observed(device: Device, settings: ObserverSettings, controller: object) -> str:
        asked.settings = settings
        return "observer"

    def settled_from(settings: ObserverSettings, device: Device, samples: int) -> int:
        asked.scored = samples
        return FIRST

    def fitted(problem: Problem, carried: tuple[str, ...], begin: None, rows: slice) -> SimpleNamespace:
        asked.fitted = carried, rows
        if residual is None:
            raise ModelError("no free run")
        return SimpleNamespace(fit=SimpleNamespace(residual=residual))

    monkeypatch.setattr(free_response, "Observer", observed)
    monkeypatch.setattr(free_response, "run", lambda observer, record: SimpleNamespace(innovation=missed))
    monkeypatch.setattr(free_response, "settled_from", settled_from)
    monkeypatch.setattr(free_response, "fitted", fitted)
    driven = np.zeros((SAMPLES, 2, 1))
    driven[7, 1] = drive
    record = Record(np.zeros((SAMPLES, 2)), driven, np.full(SAMPLES, 1.0 / RATE))
    problem = Problem(record, DEVICE, replace(DIVERGES, effects={"drag": {"dqx": 1.0}}))
    return loses_what_a_free_run_follows(problem), asked


def errs(by: float, beginning: float = 0.0) -> Array:
    """By so many amplitudes V in every sample, and by others in those that are left to the start."""
    series = np.full((SAMPLES, 2), by * 890.0 * 1e-4)
    series[:FIRST] = beginning
    return series


def test_a_motion_that_nothing_drives_goes_by_the_free_run_where_the_observer_lost_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever either does while the start lasts; lost samples count for neither."""
    missed, residual = errs(2.0), errs(1.0, beginning=99.0)
    missed[5, 0] = residual[6, 1] = np.nan
    follows, asked = free(monkeypatch, missed, residual)
    assert follows
    assert asked.settings.gain is Gain.EKF
    assert asked.scored == SAMPLES
    assert asked.fitted == (("drag",), slice(FIRST, None))


@pytest.mark.parametrize(
    ("missed", "residual", "drive"),
    [
        (errs(2.0), errs(1.0), 1e-9),  # a single sample of one axis
        (errs(0.01, beginning=9.0), errs(0.001), 0.0),  # the observer follows
        (errs(2.0), errs(2.5), 0.0),  # the free run does not
        (errs(2.0), errs(2.0), 0.0),
        (errs(2.0), None, 0.0),
        (np.where(np.arange(SAMPLES) < FIRST, 9.0, np.nan)[:, None] * np.ones(2), errs(1.0), 0.0),  # it diverged
    ],
)
def test_other_records_go_by_the_observer(
    monkeypatch: pytest.MonkeyPatch, missed: Array, residual: Array | None, drive: float
) -> None:
    assert not free(monkeypatch, missed, residual, drive)[0]
