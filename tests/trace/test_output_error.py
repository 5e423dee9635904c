"""Readings that follow no motion: their noise beside a dense covariance, and what a walk may not be taken for."""

import numpy as np
import pytest
from scipy.linalg import solve_triangular
from scipy.stats import multivariate_normal

from estimator.diagnosis import Verdict
from estimator.rate_sensor.declaration import Range
from estimator.rate_sensor.record import SensorRecord
from estimator.rate_sensor.trace import alternate_blocks, trace_sensor
from estimator.trace.output_error import whitened

RANGE = Range(3.0, 2.0)
NOISE = 2e-3


def test_innovations_are_those_of_white_noise_and_a_random_walk() -> None:
    """Beside the Cholesky factor of the whole covariance, at times that are uneven and in any order."""
    rng = np.random.default_rng(1)
    along = np.cumsum(rng.exponential(1.0, 40))
    series, walk = rng.standard_normal((40, 2)), 0.3
    since = along - along[0]
    covariance = np.eye(40) + walk * np.minimum(since[:, None], since)
    factor = np.linalg.cholesky(covariance)
    expected = solve_triangular(factor, series, lower=True)
    shuffled = rng.permutation(40)
    found, deviation = whitened(series[shuffled], along[shuffled], walk)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    np.testing.assert_allclose(deviation, np.diag(factor), rtol=1e-9)
    likelihood = -0.5 * np.sum(found[:, 0] ** 2) - np.sum(np.log(deviation)) - 20.0 * np.log(2.0 * np.pi)
    assert likelihood == pytest.approx(multivariate_normal.logpdf(series[:, 0], cov=covariance), rel=1e-9)


def test_without_a_walk_each_reading_is_its_own_innovation() -> None:
    series = np.random.default_rng(2).standard_normal((30, 1))
    found, deviation = whitened(series, np.arange(30.0), 0.0)
    np.testing.assert_allclose(found, series, atol=1e-12)
    np.testing.assert_allclose(deviation, 1.0)


def turned(t: np.ndarray) -> np.ndarray:
    return 1.2 * np.sin(0.9 * t + 1.0) + 0.8 * np.sin(2.3 * t + 2.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_an_offset_that_wanders_is_no_drift_and_no_other_effect(seed: int) -> None:
    """A random walk that comes to thirty times the noise: a straight line through it is no account of it."""
    rng = np.random.default_rng(seed)
    t = np.arange(3000) * 0.1
    walk = np.cumsum(rng.normal(0.0, NOISE * 30.0 / np.sqrt(len(t)), len(t)))
    volts = 0.4 + turned(t) / 1.5 + walk + rng.normal(0.0, NOISE, len(t))
    found = trace_sensor(SensorRecord(turned(t), volts, 0.1), RANGE, NOISE, alternate_blocks(len(t), 4))
    assert not found.effects
    assert found.verdict is Verdict.UNEXPLAINED
    assert any("nonparametric disturbance" in reason for reason in found.reasons)


@pytest.mark.moderate
@pytest.mark.parametrize("rate_Hz", [2.0, 5.0, 10.0])
def test_a_record_that_begins_in_motion_shows_no_lag(rate_Hz: float) -> None:
    """A compass beside a rate sensor, spun up before the first sample."""
    t = np.arange(400) / rate_Hz
    rate = 2.5 * np.exp(-t / 9.0) * np.cos(0.35 * t)
    volts = 0.4 + rate / 1.5 + np.random.default_rng(5).normal(0.0, NOISE, len(t))
    found = trace_sensor(SensorRecord(rate, volts, 1.0 / rate_Hz), RANGE, NOISE, alternate_blocks(len(t), 4))
    assert found.verdict is Verdict.ADEQUATE
    assert not found.effects


@pytest.mark.moderate
def test_a_walk_along_the_rate_is_a_curve_that_is_in_no_catalogue() -> None:
    rates = np.tile(np.linspace(-2.5, 2.5, 41), 3)
    volts = rates / 1.5 + 0.02 * np.sin(5.0 * rates) + np.random.default_rng(6).normal(0.0, NOISE, len(rates))
    found = trace_sensor(SensorRecord(rates, volts), RANGE, NOISE, np.arange(len(rates)) % 2 == 0)
    assert found.verdict is Verdict.UNEXPLAINED
    assert any("nonparametric disturbance" in reason for reason in found.reasons)
