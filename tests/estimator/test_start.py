"""How a pass begins: about what an earlier one found, what is held, and from which sample on it counts."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.observer import Observer
from estimator.settings import Device, Gain, ObserverSettings, Spread
from estimator.trace.start import begin_about, settled_from, settling

RATE, OMEGA = 4000.0, 2.0 * np.pi * 200.0
DEVICE = Device(
    sample_rate=RATE, stiffness=(OMEGA**2, OMEGA**2, 0.0), damping=(0.8, 0.8, 0.0), amplitude=1e-4,
    sense_gain=(890.0, 890.0), noise=(1e-4, 1e-4),
)  # fmt: skip
SETTINGS = ObserverSettings(
    gain=Gain.EKF, spread=Spread(stiffness=0.01, damping=0.5, offset=0.01, rate=0.7), effects={"drag": {"dqx": 1.0}}
)
MORE = replace(SETTINGS, effects={**SETTINGS.effects, "drive_gain": {"hx": 0.1}})
SINGLE = replace(DEVICE, stiffness=DEVICE.stiffness[:1], damping=DEVICE.damping[:1], sense_gain=(890.0,), noise=(1e-4,))


def ended(settings: ObserverSettings, device: Device = DEVICE) -> Observer:
    """An observer after a pass, with a covariance that is drawn."""
    observer = Observer(device, settings)
    random = np.random.default_rng(3).standard_normal(observer.arrays.p.shape)
    observer.arrays.p[:] = random @ random.T * 1e-6
    observer.arrays.c[:] = 2.0 * observer.arrays.p
    return observer


@pytest.mark.parametrize(("device", "settings"), [(DEVICE, SETTINGS), (DEVICE, MORE), (SINGLE, SETTINGS)])
def test_constants_begin_with_the_covariance_they_ended_with_ten_deviations_wide(
    device: Device, settings: ObserverSettings
) -> None:
    """The motion as declared; the rate, which moves, by itself; what is new behind as declared."""
    previous, observer = ended(SETTINGS, device), Observer(device, settings)
    declared = observer.arrays.p.copy()
    begin_about(observer, previous)
    expected = declared.copy()
    states, common = observer.states, len(previous.arrays.p)
    rows = [row for row in range(states, common) if observer.estimated[row] != "rate"]
    assert len(rows) == common - states - (device is DEVICE)
    expected[np.ix_(rows, rows)] = 100.0 * previous.arrays.p[np.ix_(rows, rows)]
    if device is DEVICE:
        rate = observer.estimated.index("rate")
        expected[rate, rate] = 100.0 * previous.arrays.p[rate, rate]
    np.testing.assert_array_equal(observer.arrays.p, expected)
    np.testing.assert_array_equal(observer.arrays.c, expected)
    if device is DEVICE:
        assert np.flatnonzero(observer.arrays.p[rate]).tolist() == [rate]


def test_coefficients_stand_behind_the_motion_and_the_constants() -> None:
    observer = Observer(DEVICE, MORE)
    names = observer.estimated[-len(observer.coefficient_deviations) :]
    assert names == tuple(c.name for _, effect in observer.effects for c in effect.coefficients)
    assert set(names) == {"dqx", "dqy", "hx", "hy"}
    observer.arrays.p[:] = np.diag(np.arange(1.0, len(observer.arrays.p) + 1.0) ** 2)
    last = len(observer.arrays.p)
    np.testing.assert_allclose(observer.coefficient_deviations, np.arange(last - 3, last + 1))


@pytest.mark.parametrize(
    ("memory", "samples", "first"),
    [(0.05, 10_000, 600), (0.5, 100_000, 6000), (7.0, 100_000, 12_000), (np.inf, 100_000, 12_000), (0.5, 8000, 2000)],
)
def test_three_memories_of_a_second_at_most_are_the_start_and_a_quarter_of_the_record_at_most(
    memory: float, samples: int, first: int
) -> None:
    settings = ObserverSettings(memory=memory)
    assert settled_from(settings, DEVICE, samples) == first
    assert settling(settings, DEVICE) == 3 * int(min(memory, 1.0) * RATE)
