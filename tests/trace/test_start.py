"""How a pass begins: with which motion, what is held, and from which sample on it counts."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings, Spread
from estimator.trace.start import begin_moving, first_motion

RATE, OMEGA = 4000.0, 2.0 * np.pi * 200.0
DEVICE = Device(
    sample_rate=RATE, stiffness=(OMEGA**2, OMEGA**2, 0.0), damping=(0.8, 0.8, 0.0), amplitude=1e-4,
    sense_gain=(890.0, 890.0), noise=(1e-4, 1e-4),
)  # fmt: skip
SETTINGS = ObserverSettings(
    gain=Gain.EKF, spread=Spread(stiffness=0.01, damping=0.5, offset=0.01, rate=0.7), effects={"drag": {"dqx": 1.0}}
)
SINGLE = replace(DEVICE, stiffness=DEVICE.stiffness[:1], damping=DEVICE.damping[:1], sense_gain=(890.0,), noise=(1e-4,))


def shown(samples: int, step: Array, bend: float = 0.0) -> Record:
    """Two channels of 0.7 V at OMEGA, a displacement m of each shown as m + bend m²; the drive at rest."""
    phase = OMEGA * np.cumsum(step)[:, None] + np.array([0.3, -1.1])
    moved = 0.7 * np.cos(phase)
    sense = 0.02 + moved + bend * moved**2
    return Record(sense=sense, drive=np.zeros((samples, 2, 1)), step=step)


# V and V/s, as the first interval begins
MOTION = 0.7 * np.array([np.cos([0.3, -1.1]), -OMEGA * np.sin([0.3, -1.1])])


@pytest.mark.parametrize("bend", [0.0, 0.09])
def test_the_first_cycles_tell_the_motion_whatever_the_channel_bends(bend: float) -> None:
    step = np.random.default_rng(5).uniform(0.9, 1.1, 200) / RATE
    np.testing.assert_allclose(first_motion(shown(200, step, bend), OMEGA), MOTION, rtol=1e-9)


def test_lost_samples_are_left_out_and_too_few_tell_nothing() -> None:
    record = shown(200, np.full(200, 1.0 / RATE))
    record.sense[3:9] = np.nan
    record.sense[12, 0] = np.nan
    np.testing.assert_allclose(first_motion(record, OMEGA), MOTION, rtol=1e-9)
    record.sense[6:] = np.nan
    assert np.all(np.isnan(first_motion(record, OMEGA)))
    observer = Observer(DEVICE, SETTINGS)
    as_it_was = observer.state.copy()
    begin_moving(observer, record)
    np.testing.assert_array_equal(observer.state, as_it_was)


@pytest.mark.parametrize("samples_a_cycle", [5.0, 20.0])
def test_a_pass_begins_with_that_motion_and_no_surer_of_it(samples_a_cycle: float) -> None:
    device = replace(DEVICE, sample_rate=samples_a_cycle * OMEGA / (2.0 * np.pi))
    observer = Observer(device, SETTINGS)
    spread = observer.arrays.p.copy()
    begin_moving(observer, shown(60, np.full(60, 1.0 / device.sample_rate)))
    states = dict(zip(observer.names[:4], observer.state[:4], strict=True))
    (x, y), (vx, vy) = MOTION / 890.0
    assert states == pytest.approx({"x": x, "vx": vx, "y": y, "vy": vy}, rel=1e-6)
    np.testing.assert_array_equal(observer.arrays.p, spread)


def test_the_motion_is_that_of_the_frequency_found() -> None:
    """A bench file that is 1 % off is not asked again."""
    step = np.full(60, 1.0 / RATE)
    record = Record(shown(60, step).sense, np.zeros((60, 2, 1)), step)
    off = replace(DEVICE, stiffness=(1.1 * OMEGA**2, 1.1 * OMEGA**2, 0.0))
    found = Observer(off, replace(SETTINGS, initial={"kxx": OMEGA**2, "kyy": OMEGA**2}))
    begin_moving(found, record)
    np.testing.assert_allclose(found.state[:4].reshape(2, 2).T, MOTION / 890.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("device", "initial"), [(SINGLE, {}), (DEVICE, {"vy": 0.01}), (DEVICE, {"kxx": -1.0}), (DEVICE, {"kyy": -1.0})]
)
def test_what_does_not_vibrate_on_two_axes_begins_as_it_is(device: Device, initial: dict[str, float]) -> None:
    observer = Observer(device, replace(SETTINGS, initial=initial))
    as_it_was = observer.state.copy()
    begin_moving(observer, shown(60, np.full(60, 1.0 / RATE)))
    np.testing.assert_array_equal(observer.state, as_it_was)
