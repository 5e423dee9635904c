"""Free runs of a gyro over 20 cycles at a time (docs/reference/trace.md, `simulation_rmse`)."""

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.record import Record
from estimator.settings import Device, Gain, ObserverSettings
from estimator.trace import prediction
from estimator.trace.problem import Problem

RATE, HZ = 4000.0, 200.0
TARGET = (2.0 * np.pi * HZ) ** 2
DEVICE = Device(
    sample_rate=RATE,
    stiffness=(TARGET, TARGET, 0.0),
    damping=(1.0, 1.2, 0.0),
    amplitude=1e-4,
    sense_gain=(-890.0, 900.0),
    noise=(1e-4, 2e-4),
)
FREE = 400  # samples of 20 cycles
NOISE = np.array([1e-8, 4e-8])


class Follower:
    """An observer that is what it is told, and notes with which noise it saw which samples."""

    def __init__(self, device: Device, settings: ObserverSettings, controller: object) -> None:
        self.settings = settings
        self.noise = NOISE.copy()
        self.seen: list[tuple[int, int, float]] = []
        self.held = False

    def hold_coefficients(self) -> None:
        self.held = True

    @contextmanager
    def noisier(self, factor: float) -> Iterator[None]:
        self.noise *= factor
        yield
        self.noise /= factor


def runs(monkeypatch: pytest.MonkeyPatch, samples: int, settings: ObserverSettings) -> tuple[Follower, Any]:
    made: list[Follower] = []

    def observer(*given: Any) -> Follower:
        made.append(Follower(*given))
        return made[0]

    def run(of: Follower, record: Record) -> Any:
        of.seen.append((int(record.sense[0, 0]), len(record), float(of.noise[0] / NOISE[0])))
        return SimpleNamespace(innovation=record.sense)

    monkeypatch.setattr(prediction, "Observer", observer)
    monkeypatch.setattr(prediction, "run", run)
    monkeypatch.setattr(prediction, "_begin_at", lambda of, record, first: None)
    count = np.arange(float(samples))
    record = Record(np.stack([count, -count], 1), np.zeros((samples, 2, 1)), np.full(samples, 1 / RATE))
    errors = prediction.free_run_error(Problem(record, DEVICE, settings), samples // 2)
    return made[0], errors


def test_it_runs_freely_for_20_cycles_and_follows_for_60(monkeypatch: pytest.MonkeyPatch) -> None:
    samples = 8000
    begin = 600  # three memories
    made, errors = runs(monkeypatch, samples, ObserverSettings(memory=0.05, gain=Gain.EKF))
    expected, at = [(0, begin, 1.0)], begin
    while at + FREE <= samples:
        expected.append((at, FREE, pytest.approx(1e12)))
        if at + 5 * FREE <= samples:
            expected.append((at + FREE, 3 * FREE, 1.0))
        at += 4 * FREE
    assert made.seen == expected
    assert made.held
    free = np.zeros(samples, dtype=bool)
    for first in range(begin, samples - FREE + 1, 4 * FREE):
        free[first : first + FREE] = True
    np.testing.assert_array_equal(np.isfinite(errors), np.stack([free, free], 1))
    np.testing.assert_array_equal(errors[free], np.stack([np.flatnonzero(free), -np.flatnonzero(free)], 1))


def test_a_short_record_is_followed_for_an_eighth_of_it_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    made, errors = runs(monkeypatch, 1600, ObserverSettings(memory=0.5))
    assert made.seen[0] == (0, 200, 1.0)
    assert np.flatnonzero(np.isfinite(errors[:, 0]))[[0, -1]].tolist() == [200, 599]


def test_the_last_free_run_may_end_with_the_record(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, errors = runs(monkeypatch, 600 + 13 * FREE, ObserverSettings(memory=0.05))
    assert whole.seen[-1][:2] == (600 + 12 * FREE, FREE)
    assert np.isfinite(errors[-1, 0])
    less, errors = runs(monkeypatch, 599 + 13 * FREE, ObserverSettings(memory=0.05))
    assert less.seen[-1][:2] == (600 + 8 * FREE, FREE)
    assert np.isnan(errors[-1, 0])


@pytest.mark.parametrize(
    ("gain", "runs_with"), [(Gain.STATIONARY, Gain.FADING), (Gain.EKF, Gain.EKF), (Gain.FADING, Gain.FADING)]
)
def test_a_gain_that_has_no_covariance_is_replaced(
    monkeypatch: pytest.MonkeyPatch, gain: Gain, runs_with: Gain
) -> None:
    made, _ = runs(monkeypatch, 2000, ObserverSettings(memory=0.01, gain=gain))
    assert made.settings.gain is runs_with


def test_a_free_run_is_told_where_on_the_record_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Around the split, 100 000 samples to either side; an effect that wanes does so from the record's own start."""
    began: list[Any] = []
    begin_at = prediction._begin_at
    runs(monkeypatch, 2000, ObserverSettings(memory=0.01))  # the parts' stubs
    monkeypatch.setattr(prediction, "_begin_at", lambda of, record, first: began.append((len(record), first)))
    for samples, split, first in ((2000, 1000, 0), (260_000, 130_000, 30_000)):
        record = Record(np.zeros((samples, 2)), np.zeros((samples, 2, 1)), np.full(samples, 1 / RATE))
        errors = prediction.free_run_error(Problem(record, DEVICE, ObserverSettings(memory=0.01)), split)
        assert began[-1] == (samples, first)
        told = np.flatnonzero(np.isfinite(errors[:, 0]))
        assert first < told[0] <= first + 200
        assert told[-1] < min(split + 100_000, samples)
    steps = np.array([0.5, 0.25, 0.125, 1.0])
    told: list[Any] = []
    of: Any = SimpleNamespace(begin_at=lambda *what: told.append(what))
    warm, none = np.array([21.0, 9.0]), np.zeros(0)
    for channels, first in (({}, None), ({"temperature": none}, None), ({"temperature": warm}, 21.0)):
        begin_at(of, Record(np.zeros((4, 1)), np.zeros((4, 1, 1)), steps, channels), 2)
        assert told[-1] == (0.75, first)


def test_the_start_of_a_middle_part_is_a_share_of_what_is_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An eighth of the 1600 samples around the split."""
    monkeypatch.setattr(prediction, "READ", 800)
    made, errors = runs(monkeypatch, 8000, ObserverSettings(memory=0.5))
    assert made.seen[:2] == [(3200, 200, 1.0), (3400, FREE, pytest.approx(1e12))]
    assert np.flatnonzero(np.isfinite(errors[:, 0]))[[0, -1]].tolist() == [3400, 3799]


def test_a_short_record_is_followed_for_one_sample_at_least(monkeypatch: pytest.MonkeyPatch) -> None:
    made, _ = runs(monkeypatch, 7, ObserverSettings(memory=0.5))
    assert made.seen == [(0, 1, 1.0)]
