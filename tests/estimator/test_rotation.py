"""The rotation as a state of its own: beside the observer that it follows, and beside the angle that is read off."""

import math
from dataclasses import replace

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.rotation import Rotation
from estimator.settings import Device, Gain, ObserverSettings, ProcessNoise, Spread, Variant
from tests.estimator.gyro_loop import Record, Truth, close_loop

TRUTH = Truth(offset=(8.9e-3, -8.9e-3))
RANDOM_WALK = 1.0
SETTINGS = ObserverSettings(
    gain=Gain.EKF,
    reference=1.0,
    spread=Spread(offset=8.9e-3, rate=1.0, stiffness=0.01, damping=0.3),
    process_noise=ProcessNoise(force=1e-6, rate=RANDOM_WALK),
)
SAMPLES = 12_000


def wandering(seed: int) -> tuple[Device, Record]:
    """A closed loop on a device whose initial values are as far off as declared, under a rate that is a random walk."""
    rng = np.random.default_rng([7, seed])
    rates = rng.standard_normal() + np.cumsum(rng.standard_normal(SAMPLES + 1)) * RANDOM_WALK / math.sqrt(
        TRUTH.sample_rate
    )
    k, d = TRUTH.parameters[:3], TRUTH.parameters[3:]
    device = replace(
        TRUTH.device(),
        stiffness=tuple(k + 0.01 * TRUTH.omega0**2 * rng.standard_normal(3)),
        damping=tuple(d + 0.3 * d[:2].mean() * rng.standard_normal(3)),
    )
    observer = Observer(device, replace(SETTINGS, gain=Gain.FADING), TRUTH.controller(dither=0.3))
    return device, close_loop(observer, TRUTH, SAMPLES, rates, seed=seed)


def since(angle: np.ndarray, record: Record) -> np.ndarray:
    """Error of an angle (n,) since the reference."""
    first = round(SETTINGS.reference * TRUTH.sample_rate) - 1
    error = angle - record.turned
    return np.asarray(error[first:] - error[first])


@pytest.mark.long
def test_it_is_the_same_however_the_record_is_cut_and_whatever_is_lost() -> None:
    device, record = wandering(0)
    sense = record.sense[:3000].copy()
    sense[500:504] = sense[900, 0] = sense[1200:1202, 1] = np.nan
    drive = record.drive[:3000]
    found = Observer(device, SETTINGS).run(sense, drive, every=1)
    at_once = Rotation(Observer(device, SETTINGS)).follow(found, sense)
    observer = Observer(device, SETTINGS)
    rotation = Rotation(observer)
    parts = [slice(0, 700), slice(700, 701), slice(701, 3000)]
    cut = [rotation.follow(observer.run(sense[p], drive[p], every=1), sense[p]) for p in parts]
    for whole, pieces in zip(at_once, zip(*cut, strict=True), strict=True):
        assert np.allclose(whole, np.concatenate(pieces), rtol=0.0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.long
def test_it_is_nearer_than_the_angle_read_off_and_knows_how_near() -> None:
    """Twelve devices: normalised by its deviation the error is of one, and its mean square is below the other's."""
    normalised, read_off, own = [], [], []
    for seed in range(12):
        device, record = wandering(seed)
        observer = Observer(device, SETTINGS)
        rotation = Rotation(observer)
        found = observer.run(record.sense, record.drive, every=1)
        angle, deviation = rotation.follow(found, record.sense)
        error = since(angle, record)
        normalised.append(error[-1] / deviation[-1])
        own.append(np.mean(error**2))
        read_off.append(np.mean(since(found.angle, record) ** 2))
    assert 4.40 < np.sum(np.square(normalised)) < 23.34  # 2.5 to 97.5 % of chi-square with 12
    assert np.sum(own) < 0.75 * np.sum(read_off)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"gain": Gain.FADING}, "gain of an EKF"),
        ({"variant": Variant.GYRO}, "13 states"),
        ({"effects": {"cubic_stiffness": {}}}, "leave the effects out"),
    ],
)
def test_beside_any_other_observer_it_is_refused(changes: dict[str, object], told: str) -> None:
    with pytest.raises(ModelError, match=told):
        Rotation(Observer(TRUTH.device(), replace(SETTINGS, **changes)))
