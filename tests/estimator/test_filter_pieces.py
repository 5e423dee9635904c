"""The pieces of the filter, each beside the formula that it stands for, in NumPy, SciPy or filterpy."""

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from scipy.linalg import expm, solve

from estimator.observer import Observer
from estimator.settings import Device, Gain, ObserverSettings, ProcessNoise
from tests.estimator.core_pieces import (
    ATTENTION,
    Constants,
    Estimate,
    Sample,
    add_correction,
    add_process_noise,
    correct,
    fading_factor,
    joseph,
    kalman_gain,
    measure_two,
    propagate,
    rank_one,
    recall_initial,
    remember_drive,
    remember_prior,
    runs_riccati,
    shift_drives,
    tabulated_gain,
    virtual_rate,
    widened,
    workspace,
)
from tests.estimator.gyro_loop import Array, Truth

TRUTH = Truth(force_noise=1e-5)
RANDOM = np.random.default_rng(11)


def covariance(n: int) -> Array:
    """Some positive matrix, entries of order one."""
    root = RANDOM.standard_normal((n, n))
    return root @ root.T / n + 0.1 * np.eye(n)


def observer(**settings: object) -> Observer:
    return Observer(TRUTH.device(), ObserverSettings(**settings), TRUTH.controller())  # type: ignore[arg-type]


def one_axis() -> Observer:
    return Observer(Device(4000.0, (1.6e6,), (1.0,), 1e-4, (-890.0,), (1e-4,)), ObserverSettings(gain=Gain.EKF))


@pytest.mark.parametrize(("n", "states"), [(13, 4), (15, 4), (16, 4), (7, 2)])
@pytest.mark.parametrize("factor", [1.0, 1.02])
def test_a_covariance_goes_along_with_the_flow(n: int, states: int, factor: float) -> None:
    """F p Fᵀ with F = [gᵀ; 0 I], symmetric to the last bit; a row of g that is zero moves nothing."""
    p = covariance(n)
    g = RANDOM.standard_normal((n, states))
    g[states + 1] = 0.0
    transition = np.eye(n)
    transition[:states] = g.T
    wide = widened(p)
    propagate(wide, g, np.zeros((2 * states, wide.shape[1])), factor)
    np.testing.assert_allclose(wide[:, :n], factor * transition @ p @ transition.T, rtol=1e-12)
    assert np.array_equal(wide[:, :n], wide[:, :n].T)
    assert not wide[:, n:].any()


def test_process_noise_is_that_of_a_white_force_and_of_random_walks() -> None:
    """Per axis, filterpy's white acceleration; a random walk adds its variance, and that of the rate what its jumps
    do to the velocities, Ω̇ r: with a jump of 1, ẋ gains y and ẏ loses x.
    """
    made = observer(process_noise=ProcessNoise(force=1e-3, rate=0.1, offset=1e-5, stiffness=1e-4, damping=1e-2))
    a, h = made.arrays, 0.3
    a.settings["force_noise"][0] = 0.7, 0.2
    s = np.array([0.8, -0.1, 0.3, 0.5])
    p = np.zeros((13, 13))
    a.intensity[1] = 0.0
    add_process_noise(p, a.settings[0], h, s, a.active, a.intensity, np.zeros(4))
    expected = np.zeros((13, 13))
    for axis, density in enumerate((0.7, 0.2)):
        rows = slice(2 * axis, 2 * axis + 2)
        expected[rows, rows] = Q_continuous_white_noise(2, h, density)
    for k, intensity in enumerate(a.intensity):
        jump = np.zeros(13)
        jump[4 + k] = 1.0
        if made.model.constants[k].name == "rate":
            jump[1], jump[3] = s[2], -s[0]
        expected += intensity * h * np.outer(jump, jump)
    assert np.all(a.intensity[[0, 2, 3]] > 0.0)
    np.testing.assert_allclose(p, expected, rtol=1e-12)
    assert np.array_equal(p, p.T)


@pytest.mark.parametrize("channels", [1, 2])
def test_gain_and_nis_are_those_of_the_textbook(channels: int) -> None:
    n = 6
    p, h = covariance(n), np.zeros((2, n))
    h[:channels, [0, 3, 5]] = RANDOM.standard_normal((channels, 3))
    noise, nu = np.array([0.3, 0.7]), np.array([1.1, -0.4])
    gain = np.zeros((n, 2))
    nis = kalman_gain(p, h, noise, channels, nu, gain)
    own = h[:channels]
    s = own @ p @ own.T + np.diag(noise[:channels])
    np.testing.assert_allclose(gain[:, :channels], solve(s, own @ p).T, rtol=1e-12)
    assert nis == pytest.approx(nu[:channels] @ solve(s, nu[:channels]) / channels, rel=1e-12)


@pytest.mark.parametrize("channels", [1, 2])
def test_josephs_form_holds_for_any_gain(channels: int) -> None:
    n = 7
    p, h, gain = covariance(n), np.zeros((2, n)), RANDOM.standard_normal((n, 2))
    h[:channels, [1, 2, 6]] = RANDOM.standard_normal((channels, 3))
    noise = np.array([0.3, 0.7])
    found = p.copy()
    joseph(found, h, noise, channels, gain)
    rest = np.eye(n) - gain[:, :channels] @ h[:channels]
    spent = gain[:, :channels] @ np.diag(noise[:channels]) @ gain[:, :channels].T
    np.testing.assert_allclose(found, rest @ p @ rest.T + spent, rtol=1e-11, atol=1e-13)
    assert np.array_equal(found, found.T)


@pytest.mark.parametrize("row", [0, 3])
def test_a_direct_measurement_is_josephs_form_of_one_entry(row: int) -> None:
    n, noise = 5, 0.4
    p, gain = covariance(n), RANDOM.standard_normal(n)
    found = p.copy()
    rank_one(found, row, gain, noise)
    rest = np.eye(n) - np.outer(gain, np.eye(n)[row])
    np.testing.assert_allclose(found, rest @ p @ rest.T + noise * np.outer(gain, gain), rtol=1e-11, atol=1e-13)


@pytest.mark.moderate
@pytest.mark.parametrize("n", [13, 16])
def test_two_channels_at_once_are_filterpys_update(n: int) -> None:
    """Gain, covariance, variances and NIS; and the angle's covariances, those of a state that is not measured."""
    made = observer(gain=Gain.EKF)
    work = workspace(made.arrays.settings[0], n, n + 3)
    memory = made.arrays.memory[0]
    whole = covariance(n + 1)  # the angle behind
    p = whole[:n, :n]
    h = np.zeros((2, n))
    h[:, [0, 2, 4, 5, 12]] = RANDOM.standard_normal((2, 5))
    gradient = RANDOM.standard_normal(4)
    memory["angle_cross"][:n], memory["angle_variance"], memory["gradient"] = whole[:n, n], whole[n, n], gradient
    work.jacobian[:], work.noise[:], work.innovation[:] = h, (0.3, 0.7), (1.1, -0.4)
    wide = widened(p)
    nis = measure_two(wide, memory, work)
    peer = KalmanFilter(dim_x=n, dim_z=2)
    peer.P, peer.R, peer.H = p.copy(), np.diag([0.3, 0.7]), h
    peer.update(np.array([1.1, -0.4]))
    np.testing.assert_allclose(wide[:, :n], peer.P, rtol=1e-9, atol=1e-12)
    assert np.array_equal(wide[:, :n], wide[:, :n].T)
    np.testing.assert_allclose(work.gain, peer.K, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(work.variance, np.diag(peer.S), rtol=1e-12)
    assert nis == pytest.approx((peer.y.T @ peer.SI @ peer.y).item() / 2.0, rel=1e-10)
    # A correction turns the angle by −g·K ν: the angle's row of the gain, whatever its covariance would ask for.
    gain = np.vstack([peer.K, -gradient @ peer.K[:4]])
    seen = np.column_stack([h, np.zeros(2)])
    rest = np.eye(n + 1) - gain @ seen
    expected = rest @ whole @ rest.T + gain @ peer.R @ gain.T
    np.testing.assert_allclose(memory["angle_cross"][:n], expected[:n, n], rtol=1e-9, atol=1e-11)
    assert memory["angle_variance"] == pytest.approx(expected[n, n], rel=1e-9)


@pytest.mark.parametrize(
    ("nis", "factor"), [(0.5, 1.0), (3.0, 1.0), (4.0, 1.01), (8.0, 1.05), (13.0, 1.1), (500.0, 1.1)]
)
def test_memory_shortens_where_innovations_deny_the_covariance(nis: float, factor: float) -> None:
    """By a hundredth for each NIS above 3, by a tenth at most."""
    made = observer(memory=0.5)
    settings, memory = made.arrays.settings[0], made.arrays.memory[0]
    memory["nis"] = nis
    assert fading_factor(settings, memory) == pytest.approx(settings["fade"] * factor, rel=1e-12)
    assert settings["fade"] == pytest.approx(np.exp(1.0 / (0.5 * 4000.0)), rel=1e-12)
    settings["fade"] = 1.0
    assert fading_factor(settings, memory) == 1.0


def test_an_initial_value_is_measured_again() -> None:
    """filterpy's update with the constant itself as the measurement, for both covariances under the gain of the one."""
    made = observer()
    a = made.arrays
    a.p[:] = covariance(13)
    a.c[:] = covariance(13)
    a.x[:] = RANDOM.standard_normal(13)
    x, p, c = a.x.copy(), a.p.copy(), a.c.copy()
    recall_initial(
        a.settings[0], a.active, 3, 0.7, 0.4, Estimate(a.x, a.p, a.c, a.memory[0])
    )  # fmt: skip
    peer = KalmanFilter(dim_x=13, dim_z=1)
    peer.x, peer.P, peer.R, peer.H = x[:, None], p, np.array([[0.4]]), np.eye(13)[[7]]
    peer.update(np.array([0.7]))
    np.testing.assert_allclose(a.x, peer.x[:, 0], rtol=1e-11)
    np.testing.assert_allclose(a.p, peer.P, rtol=1e-9, atol=1e-12)
    rest = np.eye(13) - peer.K @ peer.H
    np.testing.assert_allclose(a.c, rest @ c @ rest.T + 0.4 * peer.K @ peer.K.T, rtol=1e-9, atol=1e-12)


def test_one_initial_value_after_the_other_is_recalled_and_what_is_too_wide_at_once() -> None:
    """In turn, with the information that was forgotten; a variance beyond the initial one comes back to it exactly."""
    made = observer()
    a = made.arrays
    a.settings["two_covariances"] = 0
    prior = np.array([0.5, 0.0, 2.0, *[1.0] * 6])
    spread = np.full(9, 100.0)
    spread[5] = 0.2
    constants = Constants(a.intensity, prior, spread, np.arange(9.0))
    estimate = Estimate(a.x, a.p, a.c, a.memory[0])
    a.memory["cursor"] = 8
    for turn in (0, 1, 2):
        a.p[:] = np.diag(np.full(13, 0.1))
        a.p[9, 9] = 0.6
        remember_prior(a.settings[0], a.active, constants, estimate)
        assert a.memory["cursor"][0] == turn
        expected = np.full(13, 0.1)
        if prior[turn] > 0.0:
            expected[4 + turn] = 1.0 / (1.0 / 0.1 + 1.0 / prior[turn])
        expected[9] = 0.2  # 1/(1/0.6 + 1/noise) with the noise that makes it so
        np.testing.assert_allclose(np.diagonal(a.p), expected, rtol=1e-12)
    a.memory["cursor"] = 7
    remember_prior(a.settings[0], a.active, constants, estimate)
    remember_prior(a.settings[0], a.active, constants, estimate)
    assert a.memory["cursor"][0] == 0  # from the last to the first


def test_a_correction_reaches_the_constants_that_are_estimated() -> None:
    x, gain, nu = np.zeros(13), RANDOM.standard_normal((6, 2)), np.array([0.5, -2.0])
    add_correction(observer().arrays.settings[0], np.array([2, 7]), gain, nu, x)
    expected = np.zeros(13)
    expected[[0, 1, 2, 3, 6, 11]] = gain @ nu
    np.testing.assert_allclose(x, expected, rtol=1e-14)


def motion(theta: float, phase: float) -> Array:
    """(x, ẋ, y, ẏ) of a line at the angle θ, a cos(phase) along it."""
    r, v = np.cos(phase), -np.sin(phase)
    return np.array([np.cos(theta) * r, np.cos(theta) * v, np.sin(theta) * r, np.sin(theta) * v])


@pytest.mark.parametrize("theta", [-1.5, -0.4, 0.0, 0.9, 1.56])
@pytest.mark.parametrize("phase", [-3.1, -1.0, 0.2, 2.9])
def test_a_tabulated_gain_is_bilinear_and_goes_round(theta: float, phase: float) -> None:
    """A table of functions of cos 2θ, sin 2θ and of the motion's own place: the same on both sides of its edges, where
    θ + π with phase + π is the same motion.
    """
    angles, phases = 32, 32
    at_angle = -0.5 * np.pi + np.pi * np.arange(angles) / angles
    at_phase = -np.pi + 2.0 * np.pi * np.arange(phases) / phases
    whole = np.array([[motion(a, b) for b in at_phase] for a in at_angle])  # (angles, phases, 4)
    table = np.ascontiguousarray(np.stack([whole, 2.0 * whole], axis=3))
    gain = np.full((4, 2), 9.0)
    tabulated_gain(table, motion(theta, phase), gain)
    np.testing.assert_allclose(gain[:, 0], motion(theta, phase), atol=0.008)  # (π/32)²/8 and (2π/32)²/8 of it
    np.testing.assert_allclose(gain[:, 1], 2.0 * gain[:, 0], rtol=1e-12)
    i, j = 5, 7
    tabulated_gain(table, motion(at_angle[i] + 0.25 * np.pi / angles, at_phase[j] + 0.5 * np.pi / phases), gain)
    around = 0.75 * 0.75 * table[i, j] + 0.75 * 0.25 * table[i, j + 1]
    around += 0.25 * 0.75 * table[i + 1, j] + 0.25 * 0.25 * table[i + 1, j + 1]
    np.testing.assert_allclose(gain, around, atol=1e-12)


@pytest.mark.parametrize("lost", [(), (0,), (1,), (0, 1)])
def test_a_correction_by_a_tabulated_gain_leaves_the_assumed_covariance_alone(lost: tuple[int, ...]) -> None:
    """State, actual covariance and what is known of the angle go by the gain of the table, in NumPy; where a channel is
    lost, by that of the other, and nothing is given back of initial values.
    """
    made = observer()
    a, n = made.arrays, 13
    settings, memory = a.settings[0], a.memory[0]
    settings["stationary"], settings["takeover"], memory["time"] = 1, 5.0, 5.0
    whole = covariance(n + 1)
    a.p[:], a.c[:], a.x[:] = covariance(n), whole[:n, :n], 0.1 * RANDOM.standard_normal(n)
    memory["angle_cross"][:n], memory["angle_variance"] = whole[:n, n], whole[n, n]
    memory["gradient"] = RANDOM.standard_normal(4)
    x, p, nis = a.x.copy(), a.p.copy(), float(memory["nis"])
    table = RANDOM.standard_normal((4, 4, n, 2))
    gain = np.zeros((n, 2))
    tabulated_gain(table, x[:4], gain)
    z = np.array([0.7, -0.3])
    z[list(lost)] = np.nan
    nu, h = z - x[[0, 2]] - x[[4, 5]], np.zeros((2, n))
    h[0, [0, 4]] = h[1, [2, 5]] = 1.0
    nu[list(lost)], h[list(lost)], gain[:, list(lost)] = 0.0, 0.0, 0.0
    work = workspace(settings, n, n)
    constants = Constants(a.intensity, a.prior, a.spread, a.initial)
    sample = Sample(z, np.zeros((2, 1)), made.h)
    correct(settings, a.active, constants, table, Estimate(a.x, a.p, a.c, memory), sample, work)
    noise = np.diag(settings["noise"])
    k = np.vstack([gain, -memory["gradient"] @ gain[:4]])
    rest = np.eye(n + 1) - k @ np.column_stack([h, np.zeros(2)])
    expected = rest @ whole @ rest.T + k @ noise @ k.T
    np.testing.assert_allclose(a.x, x + gain @ nu, rtol=1e-12)
    np.testing.assert_allclose(a.c, expected[:n, :n], rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(memory["angle_cross"][:n], expected[:n, n], rtol=1e-9, atol=1e-11)
    assert memory["angle_variance"] == pytest.approx(expected[n, n], rel=1e-9)
    np.testing.assert_array_equal(a.p, p)
    assert memory["nis"] == nis
    np.testing.assert_allclose(work.innovation, nu, rtol=1e-12)
    np.testing.assert_allclose(work.variance, np.diagonal(h @ whole[:n, :n] @ h.T + noise), rtol=1e-12)


def test_a_table_takes_over_when_its_time_has_come() -> None:
    made = observer()
    settings, memory = made.arrays.settings[0], made.arrays.memory[0]
    settings["takeover"] = 5.0
    for stationary, time, riccati in ((0, 9.0, True), (1, 4.9, True), (1, 5.0, False), (1, 9.0, False)):
        settings["stationary"], memory["time"] = stationary, time
        assert runs_riccati(settings, memory) is riccati


def test_drives_of_intervals_before_stand_newest_first() -> None:
    past = np.arange(9 * 2 * 8, dtype=float).reshape(9, 2, 8)
    before = past.copy()
    shift_drives(past, np.array([[1.0, 2.0], [3.0, 4.0]]))
    np.testing.assert_array_equal(past[1:], before[:8])
    np.testing.assert_array_equal(past[0], [[1.0, 2.0, *[0.0] * 6], [3.0, 4.0, *[0.0] * 6]])
    long = RANDOM.standard_normal((2, 11))
    shift_drives(past, long)
    np.testing.assert_array_equal(past[0], long[:, :8])


@pytest.mark.parametrize("path", ["drive_delay", "sense_delay", "watched_drive_delay", None])
def test_drives_are_kept_for_a_path_that_is_late(path: str | None) -> None:
    made = observer()
    if path is not None:
        made.arrays.settings[path] = 0
    remember_drive(made.arrays.settings[0], made.arrays.memory[0], np.array([[1.0], [2.0]]))
    assert made.arrays.memory["past"].any() == (path is not None)


def test_attention_is_a_mean_over_twenty_samples() -> None:
    """Smoothed with a share of 1/20; an innovation of k deviations on both axes has the NIS k²."""
    made = observer(gain=Gain.EKF)
    made.run(np.zeros((1, 2)), np.zeros((1, 2)))
    before = float(made.arrays.memory["nis"][0])
    found = made.run(np.array([[0.05, -0.02]]), np.zeros((1, 2)))
    size = (found.innovation / found.innovation_deviation)[0]
    expected = before + ATTENTION * (0.5 * float(size @ size) - before)  # the axes are all but uncorrelated yet
    assert ATTENTION == 1.0 / 20.0
    assert made.arrays.memory["nis"][0] == pytest.approx(expected, rel=1e-3)


def test_a_virtual_rotation_comes_back_after_each_period() -> None:
    """Half a period one way, then a whole one the other; without reversals always the same."""
    made = Observer(TRUTH.device(), ObserverSettings(), TRUTH.controller(virtual_rotation=3.0, virtual_reversal=0.4))
    settings, scale = made.arrays.settings[0], made.scaling.omega0
    for seconds, sign in ((0.0, 1.0), (0.19, 1.0), (0.21, -1.0), (0.59, -1.0), (0.61, 1.0), (0.99, 1.0), (1.01, -1.0)):
        assert virtual_rate(settings, seconds * scale) == pytest.approx(sign * 3.0 / scale), seconds
    # Which side a sample is on that falls on the reversal does not hang on rounding: it is the one after it.
    edge = 0.2 * scale
    assert virtual_rate(settings, edge * (1.0 - 1e-12)) == virtual_rate(settings, edge * (1.0 + 1e-12))
    assert virtual_rate(settings, edge) < 0.0
    settings["reversal"] = 0.0
    assert virtual_rate(settings, 0.3 * scale) == pytest.approx(3.0 / scale)


def test_one_step_of_one_axis_is_that_of_the_matrix_exponential() -> None:
    """State, covariance and variance of the innovation of a predicted and corrected sample, in SciPy."""
    made = one_axis()
    a, h = made.arrays, made.h
    constants = made.x[2:].copy()
    names = list(made.model.names)
    k, d, b = (constants[names.index(name) - 2] for name in ("kxx", "dxx", "drive_gain_x"))
    made.x[:2] = 0.8, -0.3
    u = 0.4
    full = np.zeros((3, 3))
    full[:2] = [[0.0, 1.0, 0.0], [-k, -d, b * u]]
    state = expm(full * h) @ np.array([0.8, -0.3, 1.0])
    found = made.run(np.full((1, 1), np.nan), np.array([[u * made.scaling.drive]]))
    np.testing.assert_allclose(made.x[:2], state[:2], rtol=1e-12)
    assert np.isfinite(found.innovation_deviation).all()
    assert a.settings["axes"][0] == 1
