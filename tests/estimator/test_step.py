"""The step of its own for a set of effects: the same numbers as the general kernels, symmetric, positive, cached."""

import copy
import pickle

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from scipy.integrate import solve_ivp

from estimator.kernel import steps
from estimator.observer import Observer
from estimator.settings import Gain, ObserverSettings, ProcessNoise, Variant
from tests.estimator.agreement import disagreement
from tests.estimator.gyro_loop import Array, Record, Truth, troubled

TRUTH = Truth(force_noise=1e-5)
RANDOM_WALKS = ProcessNoise(force=1e-5, rate=0.1, offset=1e-5, stiffness=1e-4, damping=1e-2)
SETS: dict[str, dict[str, dict[str, float]]] = {
    "forces that depend on the velocity": {"cubic_stiffness": {}, "nonlinear_damping": {}},
    "forces that do not, and drive": {"quadratic_stiffness": {}, "drive_gain": {}, "drive_misalignment": {}},
    "measurement alone": {"sense_gain": {}, "sense_cubic": {}, "drive_feedthrough": {}},
    "signals in time, twice the same": {
        "base_vibration": {"omega": 900.0},
        "interference:1": {"omega": 500.0},
        "interference:2": {"omega": 700.0},
    },
    "signals that are measured or have a recursion": {
        "temperature_stiffness": {},
        "temperature_offset": {},
        "parasitic_mode": {"omega": 9000.0, "zeta": 0.1},
    },
}


@pytest.fixture(scope="module")
def record() -> Record:
    return troubled(TRUTH)


def observer(effects: dict[str, dict[str, float]], **settings: object) -> Observer:
    given = ObserverSettings(process_noise=RANDOM_WALKS, memory=1.0, effects=effects, **settings)  # type: ignore[arg-type]
    return Observer(TRUTH.device(stiffness=1.005), given, TRUTH.controller())


def given_for(name: str) -> dict[str, dict[str, float]]:
    """The set, with the parameters under the names that its effects have for them."""
    return {effect: dict(values) for effect, values in SETS[name].items()}


@pytest.mark.beyond(1)
@pytest.mark.long
@pytest.mark.parametrize("name", SETS)
def test_the_numbers_of_the_general_kernels(record: Record, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    warmth = 20.0 + 0.01 * np.arange(600)
    one = observer(given_for(name))
    assert one.may_have_step
    one.compile_step()
    assert steps.is_compiled(one.model, [effect for _, effect in one.effects])
    found = one.run(record.sense, record.drive, temperature=warmth)
    assert one.has_step
    monkeypatch.setenv("GYROHIL_KERNEL", "general")
    other = observer(given_for(name))
    other.compile_step()
    expected = other.run(record.sense, record.drive, temperature=warmth)
    assert not other.has_step
    agreement = disagreement(found, expected)
    assert max(agreement.values()) < 1e-7, agreement
    for field in ("nis", "cursor", "time", "theta", "forced", "rate_integral", "virtual_integral"):
        assert one.arrays.memory[field][0] == pytest.approx(other.arrays.memory[field][0], rel=1e-7, abs=1e-9), field
    assert not np.array_equal(found.angle, expected.angle)  # they are two computations


@pytest.fixture
def special() -> Observer:
    one = observer(given_for("forces that depend on the velocity"))
    one.compile_step()
    return one


@pytest.mark.slow
def test_samples_are_their_block(record: Record, special: Observer) -> None:
    """Sample by sample or in blocks: to the last bit the same."""
    other = observer(given_for("forces that depend on the velocity"))
    other.compile_step()
    special.run(record.sense, record.drive, every=600)
    for m in range(600):
        other.run(record.sense[m : m + 1], record.drive[m : m + 1])
    assert np.array_equal(special.x, other.x)
    assert np.array_equal(special.covariances, other.covariances)


@pytest.mark.slow
def test_a_tick_is_that_of_the_general_kernels(special: Observer) -> None:
    answers = [special.tick(100.0 * m, -50.0 * m, 3.0, -2.0) for m in range(20)]
    other = observer(given_for("forces that depend on the velocity"))
    assert [other.tick(100.0 * m, -50.0 * m, 3.0, -2.0) for m in range(20)] == answers
    assert np.allclose(special.x, other.x, rtol=1e-8, atol=1e-12)


@pytest.mark.slow
def test_covariances_stay_symmetric_and_positive(record: Record, special: Observer) -> None:
    for _ in range(50):
        special.run(record.sense, record.drive, every=600)
        for covariance in special.covariances:
            assert np.array_equal(covariance, covariance.T)
            deviation = np.sqrt(np.diagonal(covariance))
            assert np.linalg.eigvalsh(covariance / np.outer(deviation, deviation))[0] > 0.0


@pytest.mark.slow
def test_what_goes_through_the_general_kernels(special: Observer) -> None:
    effects = given_for("forces that depend on the velocity")
    for settings in (
        ObserverSettings(effects=effects, variant=Variant.GYRO),
        ObserverSettings(effects=effects, gain=Gain.EKF),
        ObserverSettings(effects={"dry_friction": {}}),
        ObserverSettings(effects={"drive_delay": {}}),
        ObserverSettings(),
    ):
        assert not Observer(TRUTH.device(), settings).may_have_step
    sense = np.zeros((4, 2))
    long = np.full(4, 0.6 / special.scaling.omega0)  # beyond what the quadrature is for
    for given in ({"step": long}, {"truth": np.zeros((4, len(special.x)))}):
        same = copy.deepcopy(special)
        assert same.has_step
        same.run(sense, sense, **given)  # type: ignore[arg-type]
        general = observer(effects)
        assert not general.has_step
        general.run(sense, sense, **given)  # type: ignore[arg-type]
        assert np.array_equal(general.x, same.x)


@pytest.mark.slow
def test_a_copy_finds_the_step_again(record: Record, special: Observer) -> None:
    special.run(record.sense[:10], record.drive[:10])
    other: Observer = pickle.loads(pickle.dumps(special))
    assert other.has_step


@pytest.mark.slow
def test_who_did_not_ask_for_it_has_the_general_kernels(record: Record, special: Observer) -> None:
    """Though it is in the cache: figures do not depend on what somebody compiled before."""
    one = observer(dict(special.settings.effects))
    assert one.may_have_step
    assert not one.has_step
    assert np.isfinite(one.run(record.sense, record.drive).angle).all()


@pytest.mark.slow
def test_a_step_beside_scipys_integration_and_filterpys_filter(special: Observer) -> None:
    """One sample from a covariance drawn at random: the equations of motion and their variational ones by SciPy, the
    filter's arithmetic by filterpy; nothing of the kernels in either.
    """
    rng = np.random.default_rng(3)
    one = Observer(
        TRUTH.device(stiffness=1.005),
        ObserverSettings(memory=1e9, process_noise=ProcessNoise(), effects=special.settings.effects),
        None,
    )
    one.compile_step()
    n = len(one.x)
    one.x[:] = [0.7, -0.4, 0.5, 0.6, 0.01, -0.02, 0.003, 1.004, 0.998, 0.001, 2e-3, 1e-3, 1e-4, 0.04, 0.03, 0.02, 0.01]
    root = 1e-6 * rng.standard_normal((n, n))
    one.arrays.p[:] = one.arrays.c[:] = root @ root.T
    x, p = one.x.copy(), one.covariances[0]
    u, z = np.array([0.02, -0.03]), np.array([0.69, 0.53])
    found = one.run((z * one.volts)[None], (u * one.scaling.drive)[None])
    assert one.has_step

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
