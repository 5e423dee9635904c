"""Does the observer know how wrong it is?  Covariances against errors, in Monte Carlo over noise and initial values."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from estimator.bound import posterior_bound
from estimator.observer import Observer
from estimator.oracle.pattern import pattern
from estimator.settings import Gain, ObserverSettings, Spread, Variant
from tests.estimator.gyro_loop import Array, Record, Truth, close_loop, observer_of

TRUTH = Truth()
RATE = 1.5
SEEDS = 200
SPREAD = Spread(offset=0.01, rate=2.0, stiffness=0.02, damping=0.5)
CONSTANTS = np.concatenate([TRUTH.offset, [RATE], TRUTH.parameters])
SCALE = TRUTH.amplitude * np.array([1.0, TRUTH.omega0, 1.0, TRUTH.omega0])
START = np.array(TRUTH.start) * SCALE


@pytest.fixture(scope="module")
def record() -> Record:
    """What a controlled device did; the noise on it is drawn anew for every observer."""
    return close_loop(observer_of(TRUTH, ObserverSettings()), TRUTH, 2000, RATE, acquire=200)


def estimated(record: Record, settings: ObserverSettings, samples: int, seeds: int) -> list[Observer]:
    """Observers after `samples` samples in fresh noise, each with initial values drawn from the initial covariance."""
    prepared = Observer(TRUTH.device(), settings)
    deviation = np.sqrt(np.diag(prepared.covariance))
    truth = np.concatenate([START, CONSTANTS])
    found = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        observer = copy.deepcopy(prepared)
        observer.x[:] = (truth + deviation * rng.standard_normal(13)) / observer.factors
        observer.arrays.initial[:] = observer.x[4:]
        noise = rng.standard_normal((samples, 2)) * TRUTH.noise + TRUTH.offset
        sense = TRUTH.sense_gain * record.motion[:samples, [0, 2]] + noise
        observer.run(sense, record.drive[:samples], every=samples)
        found.append(observer)
    return found


def errors(observers: list[Observer], record: Record, samples: int) -> Array:
    """Estimate minus truth (seeds, 13), scaled."""
    truth = np.concatenate([record.motion[samples - 1], CONSTANTS])
    return np.array([(observer.state - truth) / observer.factors for observer in observers])


def nees(error: Array, covariances: Array) -> float:
    """Mean normalised estimation error squared per state, expected 1."""
    return float(np.mean([e @ np.linalg.solve(c, e) for e, c in zip(error, covariances, strict=True)]) / error.shape[1])


def coverage(error: Array, covariances: Array) -> Array:
    """Share of the 95 % intervals that hold the truth, by state."""
    deviation = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    return np.asarray(np.mean(np.abs(error) < 1.959964 * deviation, axis=0))


@pytest.mark.slow
def test_extended_kalman_filter_is_consistent_and_reaches_the_bound(record: Record) -> None:
    samples, settings = 1500, ObserverSettings(gain=Gain.EKF, spread=SPREAD)
    observers = estimated(record, settings, samples, SEEDS)
    error, p = errors(observers, record, samples), np.array([observer.arrays.p for observer in observers])
    assert nees(error, p) == pytest.approx(1.0, abs=0.1)
    assert np.all(np.abs(coverage(error, p) - 0.95) < 0.045)
    truth = np.column_stack([record.motion[:samples], np.tile(CONSTANTS, (samples, 1))])
    bound = posterior_bound(TRUTH.device(), settings, truth, record.drive[:samples], every=samples)
    rate = np.sqrt(np.mean(error[:, 6] ** 2)) * TRUTH.omega0
    assert rate / bound.of("rate")[0] == pytest.approx(1.0, abs=0.12)
    states = np.array([observer.x[:4] for observer in observers])
    rates = np.array([observer.x[6] for observer in observers])
    true_state, true_rate = truth[-1:, :4] / SCALE, RATE / TRUTH.omega0
    found = pattern(states, 1.0, rates, rates)[0] - pattern(true_state, 1.0, true_rate, true_rate)[0]
    angle = 0.5 * np.angle(np.exp(1j * found))
    assert np.sqrt(np.mean(angle**2)) / bound.angle[0] == pytest.approx(1.0, abs=0.12)


@pytest.mark.slow
def test_fading_memory_reports_the_actual_covariance(record: Record) -> None:
    """P is a few times the true variance of constants; C beside it is true (docs/decisions/0008-observer-gains.md)."""
    samples, settings = 2000, ObserverSettings(gain=Gain.FADING, memory=0.05, spread=SPREAD)
    observers = estimated(record, settings, samples, SEEDS)
    error = errors(observers, record, samples)
    p, c = np.array([observer.covariances for observer in observers]).swapaxes(0, 1)
    assert nees(error, c) == pytest.approx(1.0, abs=0.1)
    assert np.all(np.abs(coverage(error, c) - 0.95) < 0.045)
    assert nees(error, p) < 0.5
    assert np.all(coverage(error, p)[4:] > 0.97)
    scale = np.outer(*[observers[0].factors] * 2)
    np.testing.assert_array_equal(observers[0].covariance, observers[0].covariances[1] * scale)


@pytest.mark.slow
def test_a_tabulated_gain_knows_its_errors_to_a_few_tenths(record: Record) -> None:
    settings = ObserverSettings(gain=Gain.STATIONARY, memory=0.05, acquisition=0.1, spread=SPREAD)
    observers = estimated(record, settings, 2000, 60)
    error, c = errors(observers, record, 2000), np.array([observer.arrays.c for observer in observers])
    assert nees(error, c) == pytest.approx(1.0, abs=0.35)


@pytest.mark.moderate
@pytest.mark.parametrize("gain", list(Gain))
@pytest.mark.parametrize("variant", list(Variant))
def test_covariances_stay_symmetric_and_positive_definite(record: Record, variant: Variant, gain: Gain) -> None:
    """Symmetric to the last bit, through lost samples, over a record repeated until it contradicts itself."""
    settings = ObserverSettings(variant=variant, gain=gain, memory=0.05, spread=SPREAD)
    observer = Observer(TRUTH.device(), settings)
    sense = record.sense - (TRUTH.offset if variant is Variant.GYRO else 0.0)
    sense[700:720] = np.nan
    sense[800:900, 0] = np.nan
    for _ in range(3):
        for begin in range(0, 2000, 100):
            observer.run(sense[begin : begin + 100], record.drive[begin : begin + 100])
            for covariance in (observer.arrays.p, observer.arrays.c):
                np.testing.assert_array_equal(covariance, covariance.T)
                deviation = np.sqrt(np.diag(covariance))
                assert np.linalg.eigvalsh(covariance / np.outer(deviation, deviation))[0] > 0.0


def still_pattern(samples: int, seed: int) -> tuple[Truth, Array, Array]:
    """A tuned board at rest whose pattern lies along x, without damping or drive: y tells nothing of itself."""
    truth = Truth(stiffness=(1.0, 1.0, 0.0), damping=(0.0, 0.0, 0.0), offset=(0.0, 0.0), start=(1.0, 0.0, 0.0, 0.0))
    t = np.arange(1, samples + 1) / truth.sample_rate
    sense = np.random.default_rng(seed).standard_normal((samples, 2)) * truth.noise
    sense[:, 0] += truth.sense_gain * truth.amplitude * np.cos(truth.omega0 * t)
    return truth, sense, np.zeros((samples, 2))


@pytest.mark.moderate
@pytest.mark.parametrize("remembered", [True, False])
def test_fading_memory_does_not_wind_up_in_directions_that_nothing_excites(remembered: bool) -> None:
    """400 memories long: what fades of the prior is given back; without that 15 memories are beyond all bounds."""
    truth, sense, drive = still_pattern(80_000 if remembered else 3000, seed=4)
    device = replace(truth.device(), damping=(1.0, 1.0, 0.0))
    settings = ObserverSettings(memory=0.05, spread=Spread(offset=0.01, rate=2.0, stiffness=0.02, damping=0.5))
    observer = Observer(device, settings)
    initial, sd = observer.x[4:].copy(), np.sqrt(observer.arrays.spread)
    if not remembered:
        observer.arrays.prior[:] = 1e30
        observer.arrays.spread[:] = 1e30
    found = observer.run(sense, drive, every=100)
    constants = slice(4, None)
    deviation = found.deviation[:, constants] / np.abs(observer.factors[constants]) / sd
    away = np.abs(found.state[:, constants] / observer.factors[constants] - initial) / sd
    kyy, dyy = 4, 7
    winding = np.sqrt(np.diag(observer.arrays.p)[4:]) / sd
    if remembered:
        assert np.max(winding) < 1.2
        assert np.min(winding[[kyy, dyy]]) > 0.5
        assert np.max(deviation) < 1.2
        assert np.max(away[:, [kyy, dyy]]) < 1.5
    else:
        assert np.max(winding) > 100.0


@pytest.mark.moderate
def test_a_jump_of_the_rate_is_caught_within_a_fraction_of_the_memory(record: Record) -> None:
    """The memory shortens while the innovations deny the covariance, and only then."""
    rates = np.where(np.arange(12_001) < 8000, RATE, RATE + 30.0)
    observer = observer_of(TRUTH, ObserverSettings(memory=1.0, spread=SPREAD), stiffness=1.0, damping=1.0)
    found = close_loop(observer, TRUTH, 12_000, rates)
    within = 800  # 0.2 s of a memory of 1 s
    assert np.max(np.abs(found.x[8000 + within :, 6] - rates[8000 + within : -1])) < 0.5
    assert np.std(found.x[4000:8000, 6]) < 0.02
    assert np.std(found.ratio[4000:8000]) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("gain", list(Gain))
@pytest.mark.parametrize("name", ["offset", "rate", "stiffness", "damping"])
def test_what_is_known_exactly_stays_as_it_was(record: Record, name: str, gain: Gain) -> None:
    """A spread of zero is a constant that is not estimated, under fading memory too."""
    quantities = {"offset": slice(4, 6), "rate": slice(6, 7), "stiffness": slice(7, 10), "damping": slice(10, 13)}
    known = dict(zip(("phi_x", "phi_y", "rate"), CONSTANTS, strict=False))
    settings = ObserverSettings(gain=gain, memory=0.05, initial=known, spread=replace(SPREAD, **{name: 0.0}))
    observer = Observer(TRUTH.device(), settings)
    before = observer.state[quantities[name]]
    found = observer.run(record.sense, record.drive)
    np.testing.assert_array_equal(found.state[-1, quantities[name]], before)
    assert np.all(found.deviation[:, quantities[name]] == 0.0)
    assert np.all(np.isfinite(found.state))
