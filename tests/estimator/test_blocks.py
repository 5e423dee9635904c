"""A block of samples beside the oracle in NumPy, short: every variant, gain and number of axes, and what a block hands
back.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.backend import make_observer
from estimator.core.filter import Filter
from estimator.observer import Observer
from estimator.settings import Gain, ObserverSettings, ProcessNoise, Spread, Variant
from tests.estimator.agreement import disagreement
from tests.estimator.core_pieces import command, workspace
from tests.estimator.gyro_loop import Array, Truth, free_motion
from tests.estimator.test_backends import free_record, single_axis

TRUTH = Truth(force_noise=1e-5)
NOISE = ProcessNoise(force=1e-5, rate=0.1, offset=1e-5, stiffness=1e-4, damping=1e-2, drive_gain=1e-3)
N = 70


@pytest.fixture(scope="module")
def record() -> tuple[Array, Array]:
    sense, drive = free_record(TRUTH, np.full(N, 1.0 / TRUTH.sample_rate), 1.5, np.random.default_rng(5))
    sense[20:22] = np.nan
    sense[30, 0] = np.nan
    sense[40, 1] = np.nan
    return sense, drive


def settings_of(variant: Variant, gain: Gain) -> ObserverSettings:
    return ObserverSettings(variant=variant, gain=gain, memory=0.02, process_noise=NOISE, reference=0.005)


@pytest.mark.moderate
@pytest.mark.parametrize("variant", list(Variant))
@pytest.mark.parametrize("gain", [Gain.EKF, Gain.FADING])
def test_estimates_are_the_oracles(record: tuple[Array, Array], variant: Variant, gain: Gain) -> None:
    device, settings = TRUTH.device(), settings_of(variant, gain)
    one, other = (make_observer(name, device, settings, TRUTH.controller()) for name in ("c", "numpy"))
    agreement = disagreement(one.run(*record), other.run(*record))
    assert max(agreement.values()) < 1e-7, agreement
    assert one.arrays.memory["referred"][0] == 1


@pytest.mark.moderate
@pytest.mark.parametrize("memory", [0.01, 0.05])
def test_forgetting_in_haste_and_recalling_are_the_oracles(record: tuple[Array, Array], memory: float) -> None:
    """A stiffness far beyond its spread and a blow: innovations too large, variances beyond where they began."""
    sense = record[0].copy()
    sense[50:] *= 1.2
    settings = ObserverSettings(memory=memory, spread=Spread(stiffness=0.01), process_noise=NOISE)
    device = TRUTH.device(stiffness=1.03)
    one, other = (make_observer(name, device, settings, TRUTH.controller()) for name in ("c", "numpy"))
    agreement = disagreement(one.run(sense, record[1]), other.run(sense, record[1]))
    assert float(one.arrays.memory["nis"][0]) > 3.0
    assert max(agreement.values()) < 1e-6, agreement


@pytest.mark.moderate
@pytest.mark.parametrize("gain", [Gain.EKF, Gain.FADING])
def test_one_axis_is_the_oracles(record: tuple[Array, Array], gain: Gain) -> None:
    device, settings = single_axis(TRUTH.device()), ObserverSettings(gain=gain, memory=0.02, process_noise=NOISE)
    one, other = (make_observer(name, device, settings) for name in ("c", "numpy"))
    sense, drive = (part[:, :1] for part in record)
    agreement = disagreement(one.run(sense, drive), other.run(sense, drive))
    assert max(agreement.values()) < 1e-7, agreement


def test_every_few_samples_the_state_as_it_is_then(record: tuple[Array, Array]) -> None:
    """Rows of the state at every seventh sample are those of every sample; blocks of any size give the same."""
    sense, drive = record
    settings = settings_of(Variant.FULL, Gain.FADING)
    runs = []
    for every, cuts in ((1, [0, N]), (7, [0, N]), (7, [0, 21, 56, N])):
        one = Observer(TRUTH.device(), settings, TRUTH.controller())
        parts = [
            one.run(sense[a:b], drive[a:b], every=every) for a, b in pairwise(cuts)
        ]  # fmt: skip
        runs.append((np.concatenate([p.state for p in parts]), np.concatenate([p.deviation for p in parts]), one))
    for state, deviation, one in runs[1:]:
        np.testing.assert_array_equal(state, runs[0][0][6::7])
        np.testing.assert_array_equal(deviation, runs[0][1][6::7])
        np.testing.assert_array_equal(one.x, runs[0][2].x)
        np.testing.assert_array_equal(one.covariances, runs[0][2].covariances)
        np.testing.assert_array_equal(state[-1], one.state)
        np.testing.assert_allclose(deviation[-1], np.sqrt(np.diagonal(one.covariance)), rtol=1e-12)


def test_a_block_ends_with_its_last_sample(
    record: tuple[Array, Array],
) -> None:
    ends = []
    for every in (1, 2 * N):
        one = Observer(TRUTH.device(), settings_of(Variant.FULL, Gain.FADING), TRUTH.controller())
        found = one.run(*record, every=every)
        assert len(found.state) == (N if every == 1 else 0)
        ends.append(one)
    np.testing.assert_array_equal(ends[1].x, ends[0].x)
    np.testing.assert_array_equal(ends[1].covariances, ends[0].covariances)


def test_what_is_not_estimated_has_no_deviation_and_stays(record: tuple[Array, Array]) -> None:
    one = Observer(TRUTH.device(), settings_of(Variant.SENSE, Gain.FADING), TRUTH.controller())
    begun = one.state.copy()
    found = one.run(*record)
    fixed = np.setdiff1d(np.arange(13), one.estimated_index)
    assert len(fixed) == 6
    assert not found.deviation[:, fixed].any()
    np.testing.assert_array_equal(found.state[:, fixed], np.broadcast_to(begun[fixed], (N, 6)))
    assert np.all(found.deviation[:, one.estimated_index] > 0.0)


def test_a_tick_is_a_block_of_one_sample(record: tuple[Array, Array]) -> None:
    sense, drive = record
    one, other = (Observer(TRUTH.device(), settings_of(Variant.FULL, Gain.FADING), TRUTH.controller()) for _ in "ab")
    for made in (one, other):
        made.enable_control(False)
    volts, force = other.sense_quantum, other.drive_quantum
    codes, drives = np.rint(sense / volts), np.rint(drive / force)
    found = other.run(codes * volts, drives * force)
    for m in range(N):
        assert one.tick(*codes[m], *drives[m]) == (0, 0)
        np.testing.assert_allclose(one.x, found.state[m] / other.factors, rtol=1e-9, atol=1e-10)
        assert one.newest["angle"] == pytest.approx(found.angle[m], abs=1e-9)
        assert one.newest["angle_variance"] == pytest.approx(found.angle_deviation[m] ** 2, rel=1e-7, abs=1e-20)
    np.testing.assert_allclose(one.covariances, other.covariances, rtol=1e-7, atol=1e-14)


def test_a_tick_answers_with_the_command_for_its_sample(record: tuple[Array, Array]) -> None:
    """As the control law gives it for a state that another observer comes to, which is told to drive afterwards."""
    one, other = (Observer(TRUTH.device(), settings_of(Variant.FULL, Gain.FADING), TRUTH.controller()) for _ in "ab")
    other.enable_control(False)
    codes = np.rint(record[0][0] / one.sense_quantum)
    answer = one.tick(*codes, 0.0, 0.0)
    assert other.tick(*codes, 0.0, 0.0) == (0, 0)
    np.testing.assert_array_equal(one.x, other.x)
    other.enable_control(True)
    settings, memory, expected = other.arrays.settings[0], other.arrays.memory[0], np.zeros(2)
    command(settings, memory, other.x, workspace(settings, 13, 13), expected)
    assert answer == tuple(expected.astype(int))
    assert all(answer)


def test_a_drive_is_turned_by_the_virtual_rotation_while_it_acts(record: tuple[Array, Array]) -> None:
    """Its integral counts the samples at which anything drives, on either axis, and those with control alone."""
    sense, drive = record[0], record[1].copy()
    drive[:30] = 0.0
    drive[30:40, 1] = 0.0
    drive[40:50, 0] = 0.0
    virtual = 5e-3 * TRUTH.omega0
    for on in (True, False):
        one = Observer(TRUTH.device(), settings_of(Variant.FULL, Gain.FADING), TRUTH.controller())
        one.enable_control(on)
        one.run(sense, drive)
        expected = virtual * (N - 30) / TRUTH.sample_rate if on else 0.0
        assert one.arrays.memory["virtual_integral"][0] == pytest.approx(expected, rel=1e-12)


def test_warmth_reaches_the_effects_that_move_with_it(record: tuple[Array, Array]) -> None:
    """A stiffness that goes with the temperature as one that is declared so much larger."""
    k = TRUTH.omega0**2
    exactly = ObserverSettings(gain=Gain.EKF, spread=Spread(stiffness=0.0))
    warmed = replace(exactly, effects={"temperature_stiffness": {"ktx": 1e-3 * k, "kty": 2e-3 * k}})
    kxx, kyy, kxy = TRUTH.device().stiffness
    stiffer = replace(TRUTH.device(), stiffness=(kxx + 5e-3 * k, kyy + 10e-3 * k, kxy), target_stiffness=k)
    one, other = Observer(TRUTH.device(), warmed), Observer(stiffer, exactly)
    one.hold_coefficients()
    one.run(np.full((1, 2), np.nan), np.zeros((1, 2)), temperature=np.array([20.0]))
    other.run(np.full((1, 2), np.nan), np.zeros((1, 2)))
    other.x[:4] = one.x[:4]
    for made in (one, other):
        made.arrays.p[:4, :4] = np.diag([1.0, 1.0, 1.0, 1.0])
        made.arrays.p[:4, 4:] = 0.0
        made.arrays.p[4:, :4] = 0.0
    one.run(*record, temperature=np.full(N, 25.0))
    other.run(*record)
    assert one.arrays.memory["temperature"][0] == 5.0
    np.testing.assert_allclose(one.x[:4], other.x[:4], atol=1e-6)
    np.testing.assert_allclose(one.covariances[0][:13, :13], other.covariances[0], rtol=1e-4, atol=1e-9)


@pytest.mark.slow
def test_a_gain_of_the_table_is_that_of_a_filter_held_on_the_orbit() -> None:
    """The last gain of the recursion beside one that NumPy's oracle of the same filter has there."""
    settings = ObserverSettings(gain=Gain.FADING, memory=0.05, process_noise=NOISE)
    one = Observer(TRUTH.device(), settings)
    a = one.arrays
    a.settings["ignored"][0] = 0.5 * a.settings["noise"][0]
    total, weight = np.zeros((32, 32, 13, 2)), np.zeros((32, 32))
    Filter(a._replace(table=total, p=a.p.copy())).gather(total, weight, rotation=5e-3, h=one.h, settle=12, samples=1)
    assert weight.sum() == 1.0
    i, j = np.argwhere(weight == 1.0)[0]
    p = gained(one, 13)
    h = np.zeros((2, 13))
    h[0, [0, 4]] = h[1, [2, 5]] = 1.0
    expected = np.linalg.solve(h @ p @ h.T + 1.5 * np.diag(a.settings["noise"][0]), h @ p).T
    np.testing.assert_allclose(total[i, j], expected, rtol=1e-6, atol=1e-9)
    theta = 5e-3 * one.h * 13
    assert i == round((0.5 * np.pi - theta) / np.pi * 32) % 32


def gained(one: Observer, steps: int) -> Array:
    """The predicted covariance of a filter that is on the orbit for so many steps, in NumPy: flow by SciPy."""
    h, w = one.h, 5e-3
    c = one.x[4:]
    rate, kxx, kyy, kxy, dxx, dyy, dxy = c[2:]
    a = one.arrays
    p = a.p.copy()
    fade = float(a.settings["fade"][0])
    prior = a.prior
    noise = 1.5 * np.diag(a.settings["noise"][0])
    measure = np.zeros((2, 13))
    measure[0, [0, 4]] = measure[1, [2, 5]] = 1.0

    def on_orbit(t: float) -> Array:
        fast = np.sqrt(1.0 + w * w)
        r, v = np.cos(fast * t), -fast * np.sin(fast * t)
        x, y = np.cos(w * t) * r, -np.sin(w * t) * r
        return np.array([x, np.cos(w * t) * v + w * y, y, -np.sin(w * t) * v - w * x])

    def by_constants(s: Array) -> Array:
        x, vx, y, vy = s
        g = np.zeros((4, 7))
        g[1] = [2 * rate * x + 2 * vy, -x, 0, -y, -vx, 0, -vy]
        g[3] = [2 * rate * y - 2 * vx, 0, -y, -x, 0, -vy, -vx]
        return g

    m = free_motion(rate, kxx, kyy, kxy, dxx, dyy, dxy)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    for step in range(steps):
        begin, middle = on_orbit(step * h), on_orbit((step + 0.5) * h)
        x, vx, y, vy = middle
        force = np.array([
            0.0,
            (kxx - 1) * x + kxy * y + dxx * vx + dxy * vy + 2 * w * vy,
            0.0,
            (kyy - 1) * y + kxy * x + dyy * vy + dxy * vx - 2 * w * vx,
        ])  # fmt: skip
        held = np.zeros((5, 5))
        held[:4, :4], held[:4, 4] = m, force
        f = np.eye(13)
        f[:4, :4] = expm(m * h)
        f[:4, 6:] = 0.0
        for node, weight in zip(nodes, weights, strict=True):
            t = 0.5 * h * (node + 1.0)
            there = (expm(held * t) @ np.append(begin, 1.0))[:4]
            f[:4, 6:] += 0.5 * h * weight * expm(m * (h - t)) @ by_constants(there)
        q = np.zeros((13, 13))
        for axis in range(2):
            density = float(a.settings["force_noise"][0, axis])
            rows = slice(2 * axis, 2 * axis + 2)
            q[rows, rows] = density * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
        s = on_orbit((step + 1) * h)
        for k in range(9):
            jump = np.zeros(13)
            jump[4 + k] = 1.0
            if k == 2:
                jump[1], jump[3] = s[2], -s[0]
            q += a.intensity[k] * h * np.outer(jump, jump)
        p = fade * f @ p @ f.T + q
        if step == steps - 1:
            return p
        gain = np.linalg.solve(measure @ p @ measure.T + noise, measure @ p).T
        rest = np.eye(13) - gain @ measure
        p = rest @ p @ rest.T + gain @ noise @ gain.T
        entry = 4 + (step + 1) % 9
        k = p[:, entry] / (p[entry, entry] + prior[entry - 4])
        rest = np.eye(13) - np.outer(k, np.eye(13)[entry])
        p = rest @ p @ rest.T + prior[entry - 4] * np.outer(k, k)
    return p


@pytest.mark.parametrize("effects", [{}, {"drive_delay": {}}, {"sense_delay": {}}])
def test_a_late_path_finds_the_drives_of_the_intervals_before(
    record: tuple[Array, Array], effects: dict[str, dict[str, float]]
) -> None:
    """Newest first, after a block as after single samples; nothing is kept where no path is late."""
    sense, drive = record
    one = Observer(TRUTH.device(), ObserverSettings(effects=effects, memory=0.02))
    one.run(sense[:5], drive[:5])
    one.run(sense[5:6], drive[5:6])
    kept = one.arrays.memory["past"][0, :6, :, 0] * one.scaling.drive
    np.testing.assert_allclose(kept, drive[5::-1] if effects else np.zeros((6, 2)), rtol=1e-12)


def test_an_angle_counts_from_the_exact_value_of_its_reference(record: tuple[Array, Array]) -> None:
    """At that instant it has no variance, and nothing that it shares with the state: then only what has come since."""
    device = replace(TRUTH.device(), angular_gain=0.8)
    one = Observer(device, replace(settings_of(Variant.FULL, Gain.FADING), reference=3.5 / TRUTH.sample_rate))
    before = one.run(record[0][:3], record[1][:3])
    assert np.all(before.angle_deviation > 0.0)
    assert one.arrays.memory["angle_cross"].any()
    at = one.run(record[0][3:4], record[1][3:4])
    assert at.angle_deviation[0] == 0.0
    assert not one.arrays.memory["angle_cross"].any()
    rate = float(one.covariances[1][6, 6])
    after = one.run(np.full((1, 2), np.nan), np.zeros((1, 2)))
    assert one.arrays.memory["angle_variance"][0] == pytest.approx(rate * one.h**2, rel=1e-9)
    assert after.angle_deviation[0] == pytest.approx(np.sqrt(rate) * one.h / 0.8, rel=1e-9)
