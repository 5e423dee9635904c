"""Free runs of a gyro over 20 cycles at a time (docs/reference/trace.md, `simulation_rmse`)."""

from typing import Any

import numpy as np
import pytest

from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings, Spread
from estimator.trace import prediction
from estimator.trace.problem import Problem

RATE, HZ, VOLTS = 4000.0, 200.0, 0.089
OMEGA = 2.0 * np.pi * HZ
FREE = 400  # samples of 20 cycles
SETTLED = 600  # of a memory of 50 ms


def errors(gain: Gain, off: float, samples: int = 8000, **channels: Array) -> Array:
    """Of a swing that never dies away, by a model whose springs are off by so much, (n, 2) V."""
    stiffness = OMEGA**2 * (1.0 + off)
    device = Device(
        sample_rate=RATE, stiffness=(stiffness, stiffness, 0.0), damping=(0.0, 0.0, 0.0), amplitude=1e-4,
        sense_gain=(890.0, 890.0), noise=(1e-7, 1e-7), target_stiffness=OMEGA**2,
    )  # fmt: skip
    phase = OMEGA * np.arange(samples) / RATE
    sense = VOLTS * np.stack([np.cos(phase), np.sin(phase)], axis=1)
    record = Record(sense, np.zeros((samples, 2, 1)), np.full(samples, 1.0 / RATE), channels)
    settings = ObserverSettings(memory=0.05, gain=gain, spread=Spread(stiffness=1e-12, damping=1e-9, rate=1e-9))
    return prediction.free_run_error(Problem(record, device, settings), samples // 2)


@pytest.mark.parametrize("gain", [Gain.EKF, Gain.FADING, Gain.STATIONARY])
def test_it_runs_freely_for_20_cycles_and_follows_for_60(gain: Gain) -> None:
    found = np.isfinite(errors(gain, 0.0))
    expected = np.zeros_like(found)
    for first in range(SETTLED, 8000 - FREE + 1, 4 * FREE):
        expected[first : first + FREE] = True
    np.testing.assert_array_equal(found, expected)


def test_a_right_model_stays_with_the_record_and_a_wrong_one_runs_away() -> None:
    """Of springs that are off the phase runs away in proportion to the time and to how far they are off."""
    free = slice(SETTLED, SETTLED + FREE)
    assert np.max(np.abs(errors(Gain.EKF, 0.0)[free])) < 1e-4 * VOLTS
    once, twice = (np.linalg.norm(errors(Gain.EKF, off)[free], axis=1) for off in (5e-4, 1e-3))
    assert once[-1] > 20.0 * np.pi * 5e-4 * VOLTS  # half of ε in every radian
    assert twice[-1] == pytest.approx(2.0 * once[-1], rel=0.05)
    assert once[-1] > 1.3 * once[FREE // 2]


@pytest.mark.parametrize(("channels", "warmth"), [({}, None), ({"temperature": np.linspace(21.0, 29.0, 8000)}, 21.0)])
def test_a_long_record_is_run_around_the_split(monkeypatch: pytest.MonkeyPatch, channels: Any, warmth: Any) -> None:
    """Its time and its temperature count from the record's own beginning."""
    began: list[tuple[float, float | None]] = []
    monkeypatch.setattr(prediction, "READ", 1500)
    monkeypatch.setattr(prediction.Observer, "begin_at", lambda _, *given: began.append(given))
    found = np.flatnonzero(np.isfinite(errors(Gain.EKF, 0.0, **channels)[:, 0]))
    assert 2500 < found[0] < found[-1] < 5500
    assert began == [(pytest.approx(2500 / RATE), warmth)]
