"""The observer in vector registers: the same numbers as the general kernels, symmetric, positive; and its lanes."""

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from estimator.kernel.lanes import gather, lane, put, put_columns, take
from estimator.kernel.plain import is_plain
from estimator.kernel.scan_plain import scans_plainly
from estimator.observer import Observer
from estimator.settings import Gain, ObserverSettings, ProcessNoise, Spread, Variant
from tests.estimator.agreement import disagreement
from tests.estimator.gyro_loop import Array, Record, Truth, troubled

TRUTH = Truth(force_noise=1e-5)
RANDOM_WALKS = ProcessNoise(force=1e-5, rate=0.1, offset=1e-5, stiffness=1e-4, damping=1e-2)


@pytest.fixture(scope="module")
def record() -> Record:
    return troubled(TRUTH)


def plain(observer: Observer) -> bool:
    return bool(is_plain(observer.arrays.settings[0], observer.active, observer.x))


def general(observer: Observer) -> Observer:
    """The same observer through the kernels that do everything."""
    observer.arrays.settings["general"] = 1
    assert not plain(observer)
    return observer


@pytest.mark.parametrize(
    "settings",
    [
        ObserverSettings(process_noise=RANDOM_WALKS, memory=1.0),
        ObserverSettings(process_noise=RANDOM_WALKS, memory=0.05, spread=Spread(stiffness=0.01)),
        ObserverSettings(spread=Spread(offset=0.0, damping=0.0)),  # known exactly
    ],
)
def test_the_numbers_of_the_general_kernels(record: Record, settings: ObserverSettings) -> None:
    device = TRUTH.device(stiffness=1.005)
    observer, other = (
        Observer(device, settings, TRUTH.controller()),
        general(Observer(device, settings, TRUTH.controller())),
    )
    assert plain(observer)
    found, expected = (o.run(record.sense, record.drive) for o in (observer, other))
    agreement = disagreement(found, expected)
    assert max(agreement.values()) < 1e-8, agreement
    for name in ("nis", "cursor", "time", "theta", "forced", "rate_integral", "virtual_integral"):
        assert observer.arrays.memory[name][0] == pytest.approx(other.arrays.memory[name][0], rel=1e-8, abs=1e-10), name


def test_a_switch_has_the_general_kernels_do_it(record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks and samples, and a scan asked for its quick kernel; the same to rounding, by another computation."""
    device, settings = TRUTH.device(), ObserverSettings(process_noise=RANDOM_WALKS)
    observer = Observer(device, settings, TRUTH.controller())
    monkeypatch.setenv("GYROHIL_KERNEL", "general")
    other = Observer(device, settings, TRUTH.controller())
    assert plain(observer)
    assert not plain(other)
    assert not scans_plainly(other.arrays.settings, other.active, other.x)
    found, expected = (o.run(record.sense[:100], record.drive[:100]) for o in (observer, other))
    assert max(disagreement(found, expected).values()) < 1e-8
    assert not np.array_equal(found.angle, expected.angle)
    assert observer.tick(100.0, -50.0, 3.0, -2.0) == other.tick(100.0, -50.0, 3.0, -2.0)
    assert not np.array_equal(observer.covariances, other.covariances)
    monkeypatch.setenv("GYROHIL_KERNEL", "")
    assert plain(Observer(device, settings, TRUTH.controller()))


@pytest.mark.moderate
def test_what_it_is_not_made_for() -> None:
    others = [ObserverSettings(variant=variant) for variant in (Variant.SENSE, Variant.GYRO)]
    others += [ObserverSettings(gain=gain) for gain in (Gain.EKF, Gain.STATIONARY)]
    others += [ObserverSettings(effects={"cubic_stiffness": {}})]
    assert not any(plain(Observer(TRUTH.device(), settings)) for settings in others)


@pytest.mark.moderate
def test_covariances_stay_symmetric_and_positive(record: Record) -> None:
    settings = ObserverSettings(process_noise=RANDOM_WALKS, memory=0.05)
    observer = Observer(TRUTH.device(stiffness=1.005), settings, TRUTH.controller())
    for _ in range(50):
        observer.run(record.sense, record.drive, every=600)
        for covariance in (observer.arrays.p, observer.arrays.c):
            assert np.array_equal(covariance, covariance.T)
            deviation = np.sqrt(np.diagonal(covariance))
            assert np.linalg.eigvalsh(covariance / np.outer(deviation, deviation))[0] > 0.0


def test_a_block_is_its_samples(record: Record) -> None:
    """Sample by sample or in blocks: to the last bit the same."""
    settings = ObserverSettings(process_noise=RANDOM_WALKS)
    one, other = (Observer(TRUTH.device(), settings, TRUTH.controller()) for _ in range(2))
    one.run(record.sense, record.drive, every=600)
    for m in range(600):
        other.run(record.sense[m : m + 1], record.drive[m : m + 1])
    for name in ("x", "p", "c"):
        assert np.array_equal(getattr(one.arrays, name), getattr(other.arrays, name)), name


@numba.njit
def combined(a: Array, scale: float, out: Array) -> float:
    one, other = take(a, 0, 8), take(a, 8, 8)
    put(out, 0, scale * one + other - take(a, 1, 8))
    put_columns(out, 8, one, other, take(a, 2, 8), gather((1.0, scale, 3.0, 4.0, 5.0, 6.0, 7.0, a[0])))
    return lane(other, 6)


@pytest.mark.moderate
@given(
    numbers=st.lists(st.integers(-1000, 1000), min_size=16, max_size=16),
    scale=st.integers(-1000, 1000),
)
@hypothesis_settings(deadline=None, max_examples=30)
def test_lanes_are_arithmetic_on_slices(numbers: list[int], scale: int) -> None:
    a, out = np.array(numbers, float), np.zeros(40)
    assert combined(a, float(scale), out) == a[14]
    assert np.array_equal(out[:8], scale * a[:8] + a[8:16] - a[1:9])
    rows = np.stack([a[:8], a[8:], a[2:10], [1.0, scale, 3.0, 4.0, 5.0, 6.0, 7.0, a[0]]])
    assert np.array_equal(out[8:].reshape(8, 4), rows.T)
