"""What a scan follows, over a hundred samples and one by one: beside two runs that differ a little; and the loop that
an experiment is made of, beside SciPy and an observer of its own.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from estimator.core.experiment import Plan, experiment_block
from estimator.core.following import Portion, Signatures, scan_block
from estimator.core.layout import OUTPUT
from estimator.observer import Observer
from estimator.settings import Gain, ObserverSettings, ProcessNoise, Spread
from tests.estimator.core_pieces import piece, workspace
from tests.estimator.gyro_loop import Array, Truth, free_motion
from tests.estimator.test_backends import free_record
from tests.estimator.test_effects import base, values
from tests.estimator.whitening import whitener

TRUTH = Truth(force_noise=1e-5)
N = 90
FORCES: dict[str, dict[str, float]] = {"drive_gain": {}, "cubic_stiffness": {}, "drive_delay": {}}
SENSED: dict[str, dict[str, float]] = {"sense_gain": {}, "sense_delay": {}, "drive_feedthrough": {}}
SETTINGS = ObserverSettings(
    memory=0.05,
    spread=Spread(offset=1e-3, rate=0.1, stiffness=1e-4, damping=0.01),
    process_noise=ProcessNoise(force=1e-5, rate=0.5),
    initial={  # the truth: innovations are small, and what they do to the gain is of second order
        "x": TRUTH.start[0] * TRUTH.amplitude,
        "y": TRUTH.start[2] * TRUTH.amplitude,
        "rate": 1.5,
        "phi_x": TRUTH.offset[0],
        "phi_y": TRUTH.offset[1],
    },
)


@pytest.fixture(scope="module")
def record() -> tuple[Array, Array]:
    """Sense and drive with hardly any noise; samples of one axis and of both are lost."""
    step = np.full(N, 1.0 / TRUTH.sample_rate)
    sense, drive = free_record(replace(TRUTH, noise=1e-7), step, 1.5, np.random.default_rng(5))
    sense[30, 0] = np.nan
    sense[50:52] = np.nan
    sense[70, 1] = np.nan
    return sense, drive


def of_scan(name: str, *given: Any) -> None:
    """Call a function of scan.h."""
    piece(name, *given, source="scan_pieces.c")


def made(settings: ObserverSettings, watched: int = 0, open_loop: bool = False, angular_gain: float = 1.0) -> Observer:
    device = TRUTH.device(angular_gain=angular_gain)
    return Observer(device, replace(settings, open_loop=open_loop), TRUTH.controller(), watched=watched)


def scanned(
    settings: ObserverSettings,
    watched: dict[str, dict[str, float]],
    record: tuple[Array, Array],
    *,
    level: float = 1e12,
    open_loop: bool = False,
    instants: int = N,
    step: Array | None = None,
    warmth: Array | None = None,
    angular_gain: float = 1.0,
) -> tuple[Observer, np.ndarray, Signatures]:
    one = made(replace(settings, effects=watched), len(watched), open_loop, angular_gain)
    count = len(one.names) - 13
    z, u, h, warmth = one.scaled(*record, step, warmth)
    rows = np.zeros(N, OUTPUT)
    signatures = Signatures(
        np.zeros((13, count)), level, np.zeros((2 * N, count + 1)), np.zeros(count), np.zeros((instants, count))
    )
    scan_block(one, Portion(z, u, h, warmth, rows), signatures)
    return one, rows, signatures


def carried(
    settings: ObserverSettings, name: str, sizes: dict[str, float], record: tuple[Array, Array], open_loop: bool
) -> tuple[Array, Array]:
    """Innovation over its deviation (2 N,), scaled, and angle (N,) with the effect held at these coefficients; of an
    EKF, whose innovations of both axes go together, white.
    """
    one = made(replace(settings, effects={name: sizes} if name else {}), open_loop=open_loop)
    one.hold_coefficients()
    found = one.run(*record)
    if settings.gain is not Gain.EKF:
        return (np.sign(one.volts) * found.innovation / found.innovation_deviation).ravel(), found.angle
    bare = replace(settings, open_loop=open_loop)
    white = whitener(TRUTH.device(), bare, *record, TRUTH.controller())
    return (np.sign(one.volts) * np.einsum("nab,nb->na", white, found.innovation)).ravel(), found.angle


@pytest.mark.parametrize("gain", [Gain.EKF, Gain.FADING])
@pytest.mark.parametrize(("watched", "open_loop"), [(FORCES, False), (SENSED, False), (FORCES, True)])
def test_equations_and_angle_move_as_if_the_effect_were_carried(
    record: tuple[Array, Array], gain: Gain, watched: dict[str, dict[str, float]], open_loop: bool
) -> None:
    settings = replace(SETTINGS, gain=gain)
    one, rows, found = scanned(settings, watched, record, open_loop=open_loop)
    column = 0
    normalised, angle = carried(settings, "", {}, record, open_loop)
    np.testing.assert_allclose(found.equations[:, -1], normalised, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(rows["angle"], angle, atol=1e-8)
    for name in watched:
        effect = next(effect for _, effect in one.effects if effect.name == name)
        none = {c.name: 0.0 for c in effect.coefficients}
        before = carried(settings, name, none, record, open_loop)
        for coefficient in effect.coefficients:
            scale = abs(float(one.factors[13 + column]))
            small = 1e-4 * coefficient.plausible
            after = carried(settings, name, none | {coefficient.name: small * scale}, record, open_loop)
            moved, turned = ((there - without) / small for there, without in zip(after, before, strict=True))
            seen = found.equations[:, column]
            assert np.linalg.norm(moved) > 0.1, coefficient.name
            assert np.linalg.norm(seen - moved) < 0.03 * np.linalg.norm(moved), coefficient.name
            course = found.course[:, column]
            if open_loop:  # the rate's integral, a sample behind: what is known of the rate before the correction
                course, turned = course[1:], turned[:-1]
            assert np.linalg.norm(course - turned) < 0.03 * np.linalg.norm(turned) + 1e-6, coefficient.name
            column += 1
    np.testing.assert_allclose(found.turned, found.course[-1], rtol=1e-12)


def test_samples_around_a_jump_count_less(record: tuple[Array, Array]) -> None:
    """The last sample's rows are less by the root of what the smoothed NIS is above the level."""
    one, _, whole = scanned(SETTINGS, FORCES, record)
    nis = float(one.arrays.memory["nis"][0])
    assert nis > 0.0
    _, _, less = scanned(SETTINGS, FORCES, record, level=0.4 * nis)
    last = slice(2 * N - 2, 2 * N)
    np.testing.assert_allclose(less.equations[last], whole.equations[last] * np.sqrt(0.4), rtol=1e-12)
    _, _, more = scanned(SETTINGS, FORCES, record, level=nis * 1.01)
    np.testing.assert_array_equal(more.equations[last], whole.equations[last])
    # Lost samples have no rows.
    assert not whole.equations[100:104].any()
    assert not whole.equations[60, :-1].any()
    assert not whole.equations[141, :-1].any()


def test_the_course_is_kept_at_equal_distances(record: tuple[Array, Array]) -> None:
    _, _, every = scanned(SETTINGS, FORCES, record)
    _, _, some = scanned(SETTINGS, FORCES, record, instants=9)
    np.testing.assert_array_equal(some.course, every.course[9::10])


def test_an_impulse_leaves_at_the_end_what_the_matrix_exponential_says() -> None:
    one = made(SETTINGS)
    rate, kxx, kyy, kxy, dxx, dyy, dxy = one.x[6:13]
    m = free_motion(rate, kxx, kyy, kxy, dxx, dyy, dxy)
    found = np.zeros((4, 4, 2))
    of_scan("s_responses", one.arrays.settings, one.x[4:], one.h, workspace(one.arrays.settings, 13, 13).buffer, found)
    nodes = 0.5 + 0.5 * np.polynomial.legendre.leggauss(3)[0]
    for place, at in enumerate([*nodes, 0.0]):
        np.testing.assert_allclose(found[place], expm(m * one.h * (1.0 - at))[:, [1, 3]], atol=1e-13)


def test_rows_and_pulls_are_products() -> None:
    random = np.random.default_rng(1)
    g, delta, gain = random.standard_normal((6, 4)), random.standard_normal((6, 3)), random.standard_normal(6)
    expected = np.vstack([g.T @ delta, delta[4:]])
    of_scan("s_rows", g, 4, 6, 3, delta, np.full(30, 7.0))
    np.testing.assert_allclose(delta, expected, rtol=1e-12)
    expected = expected - np.outer(gain, expected[2])
    of_scan("s_pull", 2, gain, 6, 3, delta, np.full(30, 7.0))
    np.testing.assert_allclose(delta, expected, rtol=1e-12)


@pytest.mark.moderate
@pytest.mark.parametrize("latency", [0, 2])
def test_an_experiment_is_the_model_under_the_drive_that_an_observer_asks_for(latency: int) -> None:
    """The record beside SciPy's integration under its own drive, and the drive beside a second observer's commands."""
    controller = TRUTH.controller(latency=latency)
    one, other = (Observer(TRUTH.device(), SETTINGS, controller) for _ in range(2))
    n, random = 25, np.random.default_rng(4)
    truth = one.x.copy()
    truth[:4], truth[4:6] = (1.0, 0.1, 0.2, 0.0), (0.01, -0.02)
    plan = Plan(
        rates=2e-3 * np.sin(0.3 * np.arange(n)),
        stiffness=1.0 + 0.01 * np.sign(np.sin(np.arange(n))),
        noise=1e-4 * random.standard_normal((n, 2)),
    )
    sensed, drive = np.zeros((n, 2)), np.zeros((n, 2))
    experiment_block(one, truth, plan, sensed, drive)
    k, d = truth[7:10], truth[10:13]
    s, rate = truth[:4].copy(), truth[6]
    commands = [(0.0, 0.0)] * (latency + 1)
    quanta = float(other.arrays.settings["quantum"][0]), other.arrays.settings["sense_scale"][0]
    for m in range(n):
        w = plan.rates[m]
        s = s + (w - rate) * np.array([0.0, s[2], 0.0, -s[0]])  # Euler: the rate jumps
        rate = w

        def field(_: float, y: Array, w: float = w, u: Array = drive[m]) -> list[float]:
            x, vx, yy, vy = y
            return [
                vx,
                u[0] - (k[0] - w * w) * x - k[2] * yy - d[0] * vx - d[2] * vy + 2 * w * vy,
                vy,
                u[1] - (k[1] - w * w) * yy - k[2] * x - d[1] * vy - d[2] * vx - 2 * w * vx,
            ]

        s = solve_ivp(field, (0.0, one.h), s, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        np.testing.assert_allclose(sensed[m], s[[0, 2]] + truth[4:6] + plan.noise[m], atol=1e-10)
        np.testing.assert_allclose(drive[m] / quanta[0], commands[0], atol=1e-9)
        other.arrays.settings["stiffness"] = plan.stiffness[m]
        codes = other.tick(*(sensed[m] / quanta[1]), *(drive[m] / quanta[0]))
        commands = [*commands[1:], codes]
    assert np.any(drive[5:] != 0.0)
    np.testing.assert_allclose(one.x, other.x, rtol=1e-9, atol=1e-12)


def watching(effects: dict[str, dict[str, float]]) -> Observer:
    """An observer that follows these and carries none, at a warmth of 4 and a time of 3.7."""
    one = made(replace(SETTINGS, effects=effects), len(effects))
    one.arrays.memory["temperature"], one.arrays.memory["time"] = 4.0, 3.7
    return one


def at_one(one: Observer, name: str, what: str, s: Array, u: Array, time: float) -> list[Array]:
    """By the declarations: what each coefficient of a followed effect adds to both axes where it is 1."""
    effect = next(effect for _, effect in one.effects if effect.name == name)
    of = values(effect, what)
    return [of(s, u, own, time, one.x[4:13]) for own in np.eye(len(effect.coefficients))]


@pytest.mark.moderate
def test_what_followed_forces_push_is_their_integral_along_the_motion() -> None:
    """∫ Φ(h − t) B f(t) dt by Gauss–Legendre of ten nodes in NumPy, with a drive that varies, a force of the time, of
    the direction and of the warmth; and of a late drive what it lags behind and what it jumps by.
    """
    built = made(SETTINGS).scaling
    names = ("drive_gain", "cubic_stiffness", "base_vibration", "dry_friction", "temperature_stiffness", "drive_delay")
    given = {name: {} for name in names} | {
        "base_vibration": {"omega": 0.7 * built.omega0},
        "dry_friction": {"v0": 0.02 * TRUTH.amplitude * built.omega0},
    }
    one = watching(given)
    settings, memory, h, x = one.arrays.settings[0], one.arrays.memory[0], one.h, one.x
    x[6] = 0.03
    count = len(x) - 13
    u = np.array([[0.4, -0.3, 0.2], [-0.2, 0.6, 0.1]])
    memory["past"][1, :, :2] = [[0.3, 0.1], [-0.5, 0.2]]
    before, work = np.array([0.8, 0.5, -0.3, 0.7]), workspace(settings, 13, 13)
    start = np.random.default_rng(2).standard_normal((13, count))
    delta = start.copy()
    of_scan(
        "s_forced", settings, memory, before, x, len(x), count, u, 3, h, work.buffer, np.zeros(20 * len(x)), delta
    )  # fmt: skip

    def drive(t: float) -> Array:
        return u @ (t / h) ** np.arange(3.0)

    moved = solve_ivp(
        lambda t, s: base(x[4:], s, drive(t)), (0.0, h), before, "DOP853", rtol=1e-12, atol=1e-14, dense_output=True
    )
    free = free_motion(*x[6:13])
    expected = start.copy()
    for node, weight in zip(*np.polynomial.legendre.leggauss(10), strict=True):
        t = 0.5 * h * (node + 1.0)
        pushed = [
            force
            for name in names
            if name != "drive_delay"
            for force in at_one(one, name, "force", moved.sol(t), drive(t), 3.7 - h + t)
        ]
        rising = u @ np.array([0.0, 1.0, 2.0 * t / h]) / h
        pushed += [np.array([-rising[0], 0.0]), np.array([0.0, -rising[1]])]
        expected[:4] += 0.5 * h * weight * expm(free * (h - t))[:, [1, 3]] @ np.transpose(pushed)
    jump = memory["past"][1].sum(axis=1) - u[:, 0]
    expected[:4, -2:] += expm(free * h)[:, [1, 3]] * jump
    np.testing.assert_allclose(delta, expected, atol=2e-6)
    assert np.all(np.abs(expected - start)[:4].max(axis=0) > 1e-3)


@pytest.mark.moderate
def test_what_followed_effects_show_is_taken_off_with_its_sign() -> None:
    names = ("sense_gain", "drive_feedthrough", "interference", "sense_delay")
    one = watching({name: {} for name in names} | {"interference": {"omega": 0.7 * made(SETTINGS).scaling.omega0}})
    settings, memory, x = one.arrays.settings[0], one.arrays.memory[0], one.x
    count = len(x) - 13
    x[:4] = 0.8, 0.5, -0.3, 0.7
    u, work = np.array([[0.4, -0.3], [-0.2, 0.6]]), workspace(settings, 13, 13)
    signature = np.zeros((2, count))
    of_scan("s_sensed", settings, memory, x, len(x), count, u, 2, work.buffer, np.zeros(20 * len(x)), signature)
    shown = [
        one_shown
        for name in names
        if name != "sense_delay"
        for one_shown in at_one(one, name, "sense", x[:4], u.sum(axis=1), 3.7)
    ]
    shown += [np.array([-x[1], 0.0]), np.array([0.0, -x[3]])]  # what was shown a little earlier
    np.testing.assert_allclose(signature, -np.transpose(shown), rtol=1e-12)


@pytest.mark.parametrize("rate_row", [-1, 6])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_turn_is_the_gradient_along_what_is_followed(sign: float, rate_row: int) -> None:
    random = np.random.default_rng(6)
    one = made(SETTINGS)
    one.retarget(1.2, 1.0)
    delta, begun, s = random.standard_normal((13, 3)), random.standard_normal(3), np.array([0.7, 0.2, -0.4, 0.5])
    turned, gradient = begun.copy(), np.zeros(5)
    of_scan("s_gradient", s, 1.2, 0.05, 0.02, gradient)
    of_scan("s_turn", one.arrays.settings, s, 0.05, 0.02, sign, rate_row, 3, delta, turned)
    expected = begun + sign * gradient[:4] @ delta[:4]
    if rate_row >= 0:
        expected += sign * gradient[4] * delta[rate_row]
    np.testing.assert_allclose(turned, expected, rtol=1e-12)


def test_a_pattern_that_is_none_has_no_gradient() -> None:
    found = np.full(5, 9.0)
    of_scan("s_gradient", np.zeros(4), 1.2, 0.05, 0.02, found)
    assert not found.any()


def test_recalling_pulls_along_what_is_followed() -> None:
    """The constant whose turn it is, with what was forgotten of it; then each that is wider than it began."""
    one = made(SETTINGS)
    a, random = one.arrays, np.random.default_rng(7)
    a.settings["two_covariances"] = 0
    prior, spread = np.zeros(9), np.full(9, 100.0)
    prior[3], spread[0], spread[5], spread[7] = 0.5, 0.1, 0.3, 0.0
    root = random.standard_normal((13, 13))
    p, delta = root @ root.T / 13.0 + 0.1 * np.eye(13), random.standard_normal((13, 3))
    a.p[:] = p
    a.memory["cursor"] = 3
    found = delta.copy()
    of_scan(
        "s_recall", a.settings, a.memory, a.active, 9, prior, spread, np.zeros(9), a.x, a.p, 3, np.zeros(60), found
    )  # fmt: skip
    for index in (3, 0, 5):
        row = 4 + index
        wide = p[row, row]
        noise = 0.5 if index == 3 else wide * spread[index] / (wide - spread[index])
        assert noise > 0.0
        gain = p[:, row] / (wide + noise)
        delta = delta - np.outer(gain, delta[row])
        p = p - np.outer(gain, p[row])
    np.testing.assert_allclose(found, delta, rtol=1e-9)
    np.testing.assert_allclose(a.p, p, rtol=1e-9, atol=1e-12)


def test_two_blocks_follow_as_one_through_uneven_steps_and_warmth(record: tuple[Array, Array]) -> None:
    """The responses of a step are made anew where it has another length, and each sample's warmth is taken."""
    watched: dict[str, dict[str, float]] = {"drive_gain": {}, "temperature_stiffness": {}}
    random = np.random.default_rng(9)
    step, warmth = random.uniform(0.8, 1.2, N) / TRUTH.sample_rate, 20.0 + random.uniform(0.0, 5.0, N)
    settings = replace(SETTINGS, gain=Gain.FADING)
    given: dict[str, Any] = {"step": step, "warmth": warmth, "angular_gain": 0.8}
    whole, rows, found = scanned(settings, watched, record, **given)
    again = made(replace(settings, effects=watched), len(watched), angular_gain=0.8)
    z, u, h, warm = again.scaled(*record, step, warmth)
    others = np.zeros(N, OUTPUT)
    other = Signatures(*(np.zeros_like(one) if isinstance(one, np.ndarray) else one for one in found))
    for part in (slice(0, 41), slice(41, N)):
        lines, count = slice(2 * part.start, 2 * part.stop), part.stop - part.start
        course = np.zeros((count, len(found.turned)))
        signatures = Signatures(other.delta, 1e12, other.equations[lines], other.turned, course)
        scan_block(again, Portion(z[part], u[part], h[part], warm[part], others[part]), signatures)
        other.course[part] = course
    assert np.all(np.linalg.norm(found.equations, axis=0) > 1e-3)
    for one, same in ((other.equations, found.equations), (other.course, found.course), (again.x, whole.x)):
        np.testing.assert_array_equal(one, same)
    for name in ("nu", "angle", "angle_pattern", "angle_rate_integral"):
        np.testing.assert_array_equal(others[name], rows[name])
