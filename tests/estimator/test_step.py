"""A step with effects: beside SciPy and filterpy, sample by sample as in a block, symmetric and positive, copied."""

import copy
import pickle

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from scipy.integrate import solve_ivp

from estimator.observer import Observer
from estimator.settings import ObserverSettings, ProcessNoise
from tests.estimator.gyro_loop import Array, Record, Truth, troubled

TRUTH = Truth(force_noise=1e-5)
RANDOM_WALKS = ProcessNoise(force=1e-5, rate=0.1, offset=1e-5, stiffness=1e-4, damping=1e-2)
EFFECTS: dict[str, dict[str, float]] = {"cubic_stiffness": {}, "nonlinear_damping": {}}


@pytest.fixture(scope="module")
def record() -> Record:
    return troubled(TRUTH)


@pytest.fixture
def special() -> Observer:
    given = ObserverSettings(process_noise=RANDOM_WALKS, memory=1.0, effects=dict(EFFECTS))
    return Observer(TRUTH.device(stiffness=1.005), given, TRUTH.controller())


@pytest.mark.slow
def test_samples_are_their_block(record: Record, special: Observer) -> None:
    """Sample by sample or in blocks: to the last bit the same."""
    other = copy.deepcopy(special)
    special.run(record.sense, record.drive, every=600)
    for m in range(600):
        other.run(record.sense[m : m + 1], record.drive[m : m + 1])
    assert np.array_equal(special.x, other.x)
    assert np.array_equal(special.covariances, other.covariances)


@pytest.mark.slow
def test_covariances_stay_symmetric_and_positive(record: Record, special: Observer) -> None:
    for _ in range(50):
        special.run(record.sense, record.drive, every=600)
        for covariance in special.covariances:
            assert np.array_equal(covariance, covariance.T)
            deviation = np.sqrt(np.diagonal(covariance))
            assert np.linalg.eigvalsh(covariance / np.outer(deviation, deviation))[0] > 0.0


def test_a_copy_goes_on_as_the_one_it_was_made_of(record: Record, special: Observer) -> None:
    special.run(record.sense[:10], record.drive[:10])
    other: Observer = pickle.loads(pickle.dumps(special))
    for one in (special, other):
        one.run(record.sense[10:20], record.drive[10:20])
    assert np.array_equal(special.x, other.x)


@pytest.mark.slow
def test_a_step_beside_scipys_integration_and_filterpys_filter() -> None:
    """One sample from a covariance drawn at random: the equations of motion and their variational ones by SciPy, the
    filter's arithmetic by filterpy; nothing of the core in either.
    """
    rng = np.random.default_rng(3)
    one = Observer(
        TRUTH.device(stiffness=1.005),
        ObserverSettings(memory=1e9, process_noise=ProcessNoise(), effects=dict(EFFECTS)),
        None,
    )
    n = len(one.x)
    one.x[:] = [0.7, -0.4, 0.5, 0.6, 0.01, -0.02, 0.003, 1.004, 0.998, 0.001, 2e-3, 1e-3, 1e-4, 0.04, 0.03, 0.02, 0.01]
    root = 1e-6 * rng.standard_normal((n, n))
    one.arrays.p[:] = one.arrays.c[:] = root @ root.T
    x, p = one.x.copy(), one.covariances[0]
    u, z = np.array([0.02, -0.03]), np.array([0.69, 0.53])
    found = one.run((z * one.volts)[None], (u * one.scaling.drive)[None])

    filter_ = ExtendedKalmanFilter(dim_x=n, dim_z=2)
    filter_.x, filter_.P, filter_.R, filter_.Q = (
        x[:, None].copy(),
        p.copy(),
        np.diag(one.arrays.settings["noise"][0]),
        0.0,
    )
    end, jacobian = integrated(x, u, one.h)
    filter_.F = jacobian
    filter_.predict_x = lambda u=0: setattr(filter_, "x", end[:, None])
    filter_.predict()
    predicted = filter_.x[[0, 2], 0] + filter_.x[[4, 5], 0]
    row = np.zeros((2, n))
    row[0, [0, 4]] = row[1, [2, 5]] = 1.0
    filter_.update(z[:, None], lambda _: row, lambda x: row @ x)
    assert found.innovation[0] / one.volts == pytest.approx(z - predicted, rel=1e-9)
    assert one.x == pytest.approx(filter_.x[:, 0], abs=1e-9)
    assert np.max(np.abs(one.covariances[1] - filter_.P)) < 1e-8 * np.max(np.abs(filter_.P))


def integrated(x: Array, u: Array, h: float) -> tuple[Array, Array]:
    """State vector after h and its derivative by the one before: cubic stiffness and damping that grows with the
    displacement, written down here.
    """
    n = len(x)

    def slope(s: Array) -> Array:
        q, v, r, w = s[:4]
        rate, kxx, kyy, kxy, dxx, dyy, dxy, k3x, k3y, d3x, d3y = s[6:]
        out = np.zeros(n, dtype=s.dtype)
        out[0], out[2] = v, w
        out[1] = u[0] - dxx * v - dxy * w - kxx * q - kxy * r + 2 * rate * w + rate**2 * q - k3x * q**3 - d3x * q**2 * v
        out[3] = u[1] - dxy * v - dyy * w - kxy * q - kyy * r - 2 * rate * v + rate**2 * r - k3y * r**3 - d3y * r**2 * w
        return out

    def both(_: float, state: Array) -> Array:
        s, by = state[:n], state[n:].reshape(n, n)
        local = np.column_stack([slope(s + 1e-30j * unit).imag / 1e-30 for unit in np.eye(n)])  # complex step: exact
        return np.concatenate([slope(s), (local @ by).ravel()])

    start = np.concatenate([x, np.eye(n).ravel()])
    end = solve_ivp(both, (0.0, h), start, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    return end[:n], end[n:].reshape(n, n)
