"""The pieces of the control law and of the reported angle, each beside what it stands for, written out."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from estimator.core.filter import Filter
from estimator.core.layout import OUTPUT, PHI_X, RATE
from estimator.observer import Observer
from estimator.settings import ControllerSettings, ObserverSettings
from tests.estimator.core_pieces import (
    acting,
    advance_queue,
    command,
    control_law,
    correct_angle,
    dither_force,
    holding_force,
    holds,
    note_forced_rotation,
    note_gradient,
    orbit,
    pattern,
    read_angle,
    recall_angle,
    refer_angle,
    undo_effects,
    workspace,
)
from tests.estimator.gyro_loop import Array, Truth

TRUTH = Truth()


def observer(effects: dict[str, dict[str, float]] | None = None, **control: object) -> Observer:
    settings = ObserverSettings(effects=effects or {})
    return Observer(TRUTH.device(), settings, TRUTH.controller(**control))


def xorshift(state: int) -> int:
    """Marsaglia's xorshift64 with 13, 7, 17 in whole numbers."""
    state ^= state << 13 & (1 << 64) - 1
    state ^= state >> 7
    return state ^ (state << 17 & (1 << 64) - 1)


def test_dither_is_the_sign_of_a_bit_of_xorshift() -> None:
    made = observer()
    memory = made.arrays.memory[0]
    state = 88172645463325252
    memory["dither"] = state
    for _ in range(70):
        state = xorshift(state)
        assert dither_force(memory, 0.3) == (0.3 if state >> 32 & 1 else -0.3)
        assert int(memory["dither"]) == state


def energy_of(s: Array, w: float, rate: float) -> tuple[float, float]:
    """Energy and angular momentum in the frame in which the pattern rests, target stiffness 1."""
    x, vx, y, vy = s[0], s[1] - w * s[2], s[2], s[3] + w * s[0]
    return 0.5 * ((1.0 + w * w - rate * rate) * (x * x + y * y) + vx * vx + vy * vy), x * vy - y * vx


@pytest.mark.parametrize("size", [0.01, 0.7, 1.0, 1.1, 3.0])
@pytest.mark.parametrize("fastest", [np.inf, 1e-3])
def test_holds_are_proportional_and_bounded(size: float, fastest: float) -> None:
    """Damping by what energy is missing, a force across by what quadrature there is; each within its bounds."""
    made = observer(energy_gain=0.02, quadrature_gain=0.005)
    s = size * np.array([0.9, 0.1, 0.2, 0.3])
    w, rate = 0.012, 0.004
    energy, momentum = energy_of(s, w, rate)
    hold, square = holds(made.arrays.settings[0], made.arrays.memory[0], s, rate, w, fastest)
    error = np.clip((0.5 - energy) / 0.5, -2.0, 2.0)
    assert hold == pytest.approx(min(0.02, fastest) * error, rel=1e-12)
    ratio = np.clip(momentum / max(energy, 0.5e-3), -1.0, 1.0)
    assert square == pytest.approx(-min(0.005, fastest) * ratio, rel=1e-12)


def test_a_start_from_rest_is_driven_by_twice_the_gain_at_most() -> None:
    """At the crest of a modulation by 60 % the energy that is missing is 2.56 times that of the amplitude."""
    made = observer(energy_gain=0.02, modulation=0.6, modulation_rate=0.01 * TRUTH.omega0)
    settings, memory = made.arrays.settings[0], made.arrays.memory[0]
    memory["time"] = 0.5 * math.pi / float(settings["modulation_rate"])
    hold, _ = holds(settings, memory, np.zeros(4), 0.0, 0.0, np.inf)
    assert hold == pytest.approx(2.0 * 0.02, rel=1e-12)


def test_holds_act_in_the_frame_in_which_the_pattern_rests() -> None:
    """Damping along the velocity that is seen there, a force across the position: with the board's rate and the virtual
    rotation, beside formula (9) alone, which is the law with both holds off.
    """
    s, c = 1.2 * np.array([0.9, 0.1, 0.2, 0.3]), np.zeros(9)
    c[RATE], virtual = 0.03, 0.05
    force = {}
    for gains in ((0.0, 0.0), (0.02, 0.0), (0.0, 0.005)):
        made = observer(energy_gain=gains[0], quadrature_gain=gains[1], virtual_rotation=virtual * TRUTH.omega0)
        settings, memory = made.arrays.settings[0], made.arrays.memory[0]
        force[gains] = np.zeros(2)
        control_law(settings, memory, s, c, force[gains])
        hold, square = holds(settings, memory, s, c[RATE], c[RATE] + virtual, np.inf)
        velocity = np.array([s[1] - (c[RATE] + virtual) * s[2], s[3] + (c[RATE] + virtual) * s[0]])
        across = np.array([-s[2], s[0]])
        added = force[gains] - force[0.0, 0.0]
        np.testing.assert_allclose(added, hold * velocity + square * across, rtol=0.0, atol=1e-15)
        assert (hold != 0.0, square != 0.0) == (gains[0] > 0.0, gains[1] > 0.0)


def test_holds_follow_a_modulated_amplitude_and_a_stiffer_target() -> None:
    """The energy aimed at goes with the square of 1 + m sin; gains are relative to the target's own frequency."""
    made = observer(energy_gain=0.02, quadrature_gain=0.005, modulation=0.3, modulation_rate=0.01 * TRUTH.omega0)
    made.retarget(1.21, 1.0)
    made.arrays.memory["time"] = 40.0
    s = np.array([0.6, 0.1, 0.2, 0.3])
    energy = 0.5 * (1.21 * (0.6**2 + 0.2**2) + 0.1**2 + 0.3**2)
    momentum = 0.6 * 0.3 - 0.2 * 0.1
    hold, square = holds(made.arrays.settings[0], made.arrays.memory[0], s, 0.0, 0.0, np.inf)
    target = 0.605 * (1.0 + 0.3 * math.sin(0.01 * 40.0)) ** 2
    assert hold == pytest.approx(0.02 * 1.1 * (target - energy) / 0.605, rel=1e-12)
    assert square == pytest.approx(-0.005 * 1.1 * 1.1 * (1.1 * momentum / energy), rel=1e-12)


@pytest.mark.parametrize(
    ("effects", "coefficients"),
    [
        ({"drive_gain": {}}, (0.2, -0.3)),
        ({"drive_gain": {}, "cubic_stiffness": {}}, (0.2, -0.1, 0.15, 0.05)),
        ({"drive_gain": {}}, (-1.9, 0.1)),  # one axis acts the wrong way round
    ],
)
def test_with_the_effects_the_force_is_what_was_wanted(
    effects: dict[str, dict[str, float]], coefficients: tuple[float, ...]
) -> None:
    """Undone, a gain error g leaves (1 + g) f, and a spring's k3 x³ is cancelled: what acts is what was asked for."""
    made = observer(effects)
    made.x[13:] = coefficients
    s = np.array([0.8, -0.1, 0.3, 0.5])
    work = workspace(made.arrays.settings[0], len(made.arrays.p), len(made.x))
    force = np.array([0.4, -0.7])
    undo_effects(made.arrays.settings[0], made.x[4:].copy(), s, work, force)
    acts = force * (1.0 + np.array(coefficients[:2]))
    if len(coefficients) == 4:
        acts = acts - np.array(coefficients[2:]) * s[[0, 2]] ** 3
    np.testing.assert_allclose(acts, [0.4, -0.7], rtol=0.3**6, atol=1e-3)


@pytest.mark.moderate
def test_the_queue_moves_on_and_tells_what_was_applied() -> None:
    made = observer(latency=2)
    a = made.arrays
    settings, memory = a.settings[0], a.memory[0]
    quantum = float(settings["quantum"])
    memory["queue"][:3] = [[2 * quantum, 3 * quantum, 0.7], [5 * quantum, 0.0, 0.8], [7 * quantum, 1.0, 0.9]]
    later = memory["queue"][1:3].copy()
    for echo, before, applied in (
        ((2.0, 3.0), 0.1, 0.7),  # what was commanded
        ((2.4, 3.4), 0.1, 0.7),  # … rounded
        ((2.6, 3.0), 0.1, 0.1),  # something else: held from before
        ((2.0, 3.6), 0.1, 0.1),
        ((0.0, 0.0), 0.1, 0.0),  # a board in SAFE
        ((0.0, 1.0), 0.1, 0.1),
    ):
        memory["queue"][:3] = [[2 * quantum, 3 * quantum, 0.7], *later]
        memory["virtual_applied"] = before
        advance_queue(settings, memory, np.array(echo) * quantum)
        assert memory["virtual_applied"] == pytest.approx(applied), echo
        np.testing.assert_array_equal(memory["queue"][:2], later)


@pytest.mark.parametrize("latency", [0, 1, 3])
def test_a_command_is_the_law_at_the_middle_of_its_interval(latency: int) -> None:
    """(9) for an isotropic device without damping that turns: only the virtual rotation's 2 Ωv × velocity is left,
    at the state after the queued drives, half a sample on with the target's flow, over what the hold leaves of it.
    """
    k = TRUTH.omega0**2
    device = TRUTH.device(stiffness=1.0)
    made = Observer(
        device, ObserverSettings(), TRUTH.controller(latency=latency, energy_gain=0.0, quadrature_gain=0.0)
    )  # fmt: skip
    a, h = made.arrays, made.h
    settings, memory = a.settings[0], a.memory[0]
    virtual = 5e-3
    made.x[4:] = 0.0
    names = list(made.model.names)
    made.x[names.index("kxx")] = made.x[names.index("kyy")] = 1.0
    made.x[:4] = 0.8, -0.1, 0.3, 0.5
    queued = np.array([[0.02, -0.01], [0.03, 0.01], [-0.02, 0.02]])[:latency]
    memory["queue"][:latency, :2] = queued
    one = np.zeros((6, 6))
    one[0, 1] = one[2, 3] = 1.0
    one[1, 0] = one[3, 2] = -1.0
    one[1, 4] = one[3, 5] = 1.0
    s = made.x[:4].copy()
    for drive in queued:
        s = (expm(one * h) @ np.concatenate([s, drive]))[:4]
    target = one[:4, :4].copy()
    target[1, 3], target[3, 1] = 2.0 * virtual, -2.0 * virtual
    target[1, 0] = target[3, 2] = -1.0 + virtual**2
    s = expm(target * 0.5 * h) @ s
    wanted = 2.0 * virtual * np.array([s[3], -s[1]])
    hold = math.sin(0.5 * h) / (0.5 * h)
    codes = np.zeros(2)
    command(settings, memory, made.x, workspace(settings, 13, 13), codes)
    np.testing.assert_allclose(codes, wanted / hold / float(settings["quantum"]), atol=0.5001)
    assert np.all(np.abs(codes) > 20)
    np.testing.assert_allclose(memory["queue"][latency], [*(codes * settings["quantum"]), virtual], rtol=1e-12)
    assert k > 0.0
    memory["queue"][:] = 0.0
    made.enable_control(False)
    command(settings, memory, made.x, workspace(settings, 13, 13), codes)
    assert not codes.any()
    assert not memory["queue"].any()


def test_a_command_looks_ahead_by_the_delay_of_its_own_drive() -> None:
    """Half a sample and what the drive of that axis is late by, each axis its own; nothing is under way."""
    made = Observer(
        TRUTH.device(stiffness=1.0),
        ObserverSettings(effects={"drive_delay": {}}),
        TRUTH.controller(latency=0, energy_gain=0.0, quadrature_gain=0.0),
    )
    settings, memory, h, virtual = made.arrays.settings[0], made.arrays.memory[0], made.h, 5e-3
    late = np.array([0.3, 0.8]) * h
    made.x[4:] = 0.0
    names = list(made.model.names)
    made.x[names.index("kxx")] = made.x[names.index("kyy")] = 1.0
    made.x[:4] = 0.8, -0.1, 0.3, 0.5
    made.x[13:15] = late
    target = np.zeros((4, 4))
    target[0, 1] = target[2, 3] = 1.0
    target[1, 0] = target[3, 2] = -1.0 + virtual**2
    target[1, 3], target[3, 1] = 2.0 * virtual, -2.0 * virtual
    ahead = [expm(target * (0.5 * h + one)) @ made.x[:4] for one in late]
    wanted = 2.0 * virtual * np.array([ahead[0][3], -ahead[1][1]])
    codes = np.zeros(2)
    command(settings, memory, made.x, workspace(settings, 13, len(made.x)), codes)
    hold = math.sin(0.5 * h) / (0.5 * h)
    np.testing.assert_allclose(codes, wanted / hold / float(settings["quantum"]), atol=0.5001)
    assert np.all(np.abs(codes) > 20)


def test_commands_are_limited_dithered_and_never_nan() -> None:
    made = Observer(
        TRUTH.device(stiffness=1.1),
        ObserverSettings(),
        ControllerSettings(latency=0, force_quantum=1e-3, force_limit=2.0, sense_quantum=1e-5, dither=0.5),
    )
    settings, memory = made.arrays.settings[0], made.arrays.memory[0]
    work, codes = workspace(settings, 13, 13), np.zeros(2)
    made.x[:4] = 1.0, 0.0, -1.0, 0.0
    command(settings, memory, made.x, work, codes)
    np.testing.assert_array_equal(np.abs(codes), [2000.0, 2000.0])
    made.x[0] = np.nan
    command(settings, memory, made.x, work, codes)
    assert np.isfinite(codes).all()
    assert not codes.any()
    made.x[:] = 0.0  # nothing moves and nothing is known to: the energy hold has nothing to act on
    command(settings, memory, made.x, work, codes)
    np.testing.assert_array_equal(np.abs(codes), [500.0, 500.0])


def test_the_angle_is_the_pattern_less_what_forces_turned_it_by() -> None:
    """Over half-turns, with an angular gain, from the first reading on; in open loop the integrated rate."""
    made = observer()
    a, h = made.arrays, 0.25
    settings, memory = a.settings[0], a.memory[0]
    settings["angular_gain"] = 0.8
    row = np.zeros(1, OUTPUT)
    thetas, rate, virtual = np.cumsum([1.2, 0.5, 0.5, 0.5, -0.4]), 0.03, 0.01
    memory["virtual_applied"] = virtual
    total = 0.0
    for n, theta in enumerate(thetas):
        w = rate + virtual
        along, across = math.cos(theta), math.sin(theta)
        made.x[:4] = 0.9 * along, 0.9 * w * across, 0.9 * across, -0.9 * w * along  # at its turning point, as it turns
        made.x[4:] = 0.0
        made.x[4 + RATE] = rate
        forced = 0.0 if n == 0 else 0.02 * n
        memory["forced"] += forced
        total += forced
        read_angle(settings, memory, made.x, h, row[0])
        out = row[0]
        assert out["angle"] == pytest.approx((thetas[0] - theta + total) / 0.8, abs=1e-12)
        assert out["angle_forced"] == pytest.approx(-total / 0.8, abs=1e-12)
        assert out["angle_pattern"] == pytest.approx((thetas[0] - theta - n * virtual * h) / 0.8, abs=1e-12)
        assert out["angle_rate_integral"] == pytest.approx(n * rate * h / 0.8, abs=1e-12)
        ke = 1.0 + w * w - rate * rate
        assert out["energy_ratio"] == pytest.approx(ke * 0.81, rel=1e-12)
        assert out["quadrature_ratio"] == pytest.approx(0.0, abs=1e-12)
        assert (memory["rotation"], memory["rate"]) == (pytest.approx(w), pytest.approx(rate))
    # By (11) as it is printed: what the board's own rotation leaves in the velocities is part of it.
    double, _, _ = pattern(made.x, 1.0, 0.0, 0.0)
    plain = out["angle_plain"] * 0.8 + (len(thetas) - 1) * virtual * h
    first = 0.5 * math.atan2(math.sin(2 * thetas[0]), math.cos(2 * thetas[0]))
    assert math.sin(2 * (first - plain) - double) == pytest.approx(0.0, abs=5e-3)
    settings["open_loop"] = 1
    read_angle(settings, memory, made.x, h, row[0])
    assert row[0]["angle"] == row[0]["angle_rate_integral"]
    made.x[:4] = 0.0
    read_angle(settings, memory, made.x, h, row[0])
    assert row[0]["quadrature_ratio"] == 0.0


def test_an_ellipse_has_its_quadrature() -> None:
    made = observer()
    made.x[:4], made.x[4:] = (0.9, 0.0, 0.0, 0.2), 0.0
    row = np.zeros(1, OUTPUT)
    read_angle(made.arrays.settings[0], made.arrays.memory[0], made.x, 0.1, row[0])
    assert row[0]["quadrature_ratio"] == pytest.approx(2.0 * 0.9 * 0.2 / (0.81 + 0.04), rel=1e-12)
    made.retarget(1.44, 1.0)
    read_angle(made.arrays.settings[0], made.arrays.memory[0], made.x, 0.1, row[0])
    assert row[0]["quadrature_ratio"] == pytest.approx(2.0 * 1.2 * 0.9 * 0.2 / (1.44 * 0.81 + 0.04), rel=1e-12)


def test_the_angle_as_printed_is_that_of_the_long_axis() -> None:
    """(11) without any rotation: of a line at rest at its end, and of an ellipse at any of its points."""
    made = observer(virtual_rotation=0.0)
    settings, memory, row = made.arrays.settings[0], made.arrays.memory[0], np.zeros(1, OUTPUT)
    made.x[4:] = 0.0
    for angle, minor, phase in ((0.3, 0.0, 0.0), (0.5, 0.2, 0.7), (0.4, 0.3, 2.0)):
        along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
        made.x[[0, 2]] = 0.9 * math.cos(phase) * along + minor * math.sin(phase) * across
        made.x[[1, 3]] = -0.9 * math.sin(phase) * along + minor * math.cos(phase) * across
        read_angle(settings, memory, made.x, made.h, row[0])
        assert row[0]["angle_plain"] == pytest.approx(0.3 - angle, abs=1e-12)
        assert row[0]["angle_pattern"] == pytest.approx(0.3 - angle, abs=1e-12)


def test_what_forces_turned_the_pattern_by_is_what_the_rate_did_not() -> None:
    """The pattern turned from 0.3 to 0.25 while the rate alone would have taken it to 0.3 − Ωh: the rest is forced."""
    made = observer()
    memory = made.arrays.memory[0]
    memory["theta"], memory["rate"], memory["rotation"] = 0.3, 0.02, 0.02
    theta, w = 0.25, 0.02
    s = np.array([math.cos(theta), w * math.sin(theta), math.sin(theta), -w * math.cos(theta)])
    note_forced_rotation(made.arrays.settings[0], memory, s, 0.5)
    assert memory["forced"] == 0.0  # not before the first reading
    memory["started"] = 1
    note_forced_rotation(made.arrays.settings[0], memory, s, 0.5)
    assert memory["forced"] == pytest.approx(0.25 - 0.3 + 0.02 * 0.5, abs=1e-12)
    note_forced_rotation(made.arrays.settings[0], memory, s, 0.5)
    assert memory["forced"] == pytest.approx(2 * (0.25 - 0.3 + 0.02 * 0.5), abs=1e-12)


def test_the_gradient_of_the_angle_is_that_of_formula_11() -> None:
    made = observer()
    settings, memory = made.arrays.settings[0], made.arrays.memory[0]
    made.retarget(1.2, 1.0)
    s = np.array([0.7, 0.2, -0.4, 0.5])
    note_gradient(settings, memory, s)
    for i in range(4):
        ends = []
        for side in (-1e-6, 1e-6):
            moved = s.copy()
            moved[i] += side
            x, vx, y, vy = moved
            ends.append(0.5 * math.atan2(2 * (1.2 * x * y + vx * vy), 1.2 * (x * x - y * y) + vx * vx - vy * vy))
        assert memory["gradient"][i] == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=1e-7)
    for case in ("rest", "open loop"):
        if case == "open loop":
            settings["open_loop"] = 1
        note_gradient(settings, memory, np.zeros(4) if case == "rest" else s)
        assert not memory["gradient"].any(), case


def test_the_reference_instant_comes_once() -> None:
    made = observer()
    settings, memory = made.arrays.settings[0], made.arrays.memory[0]
    settings["reference"] = 2.0
    found = []
    for time in (0.0, 1.9, 2.0, 2.1, 9.0):
        memory["time"] = time
        found.append(refer_angle(settings, memory))
    assert found == [False, False, True, False, False]


def known(random: np.random.Generator, n: int) -> tuple[Any, Array]:
    """An observer's memory of an angle that depends on its state by a drawn gradient, and the covariance
    (n + 1, n + 1) of state and angle together."""
    root = random.standard_normal((n + 1, n + 1))
    whole = root @ root.T
    memory = observer().arrays.memory[0]
    memory["gradient"] = random.standard_normal(4)
    memory["angle_cross"][:n], memory["angle_variance"] = whole[:n, n], whole[n, n]
    return memory, whole


@pytest.mark.parametrize("channels", [1, 2])
def test_a_correction_moves_what_is_known_of_the_angle(channels: int) -> None:
    """Joseph's form of state and angle together, the angle's row of the gain −g·K; any gain."""
    random = np.random.default_rng(2)
    n = 6
    memory, whole = known(random, n)
    h, gain = np.zeros((2, n)), random.standard_normal((n, 2))
    h[:channels, [0, 4]] = random.standard_normal((channels, 2))
    noise = np.array([0.3, 0.7])
    correct_angle(memory, whole[:n, :n].copy(), h, noise, channels, gain)
    k = np.vstack([gain, -memory["gradient"] @ gain[:4]])[:, :channels]
    rest = np.eye(n + 1) - k @ np.column_stack([h, np.zeros(2)])[:channels]
    expected = rest @ whole @ rest.T + k @ np.diag(noise[:channels]) @ k.T
    np.testing.assert_allclose(memory["angle_cross"][:n], expected[:n, n], rtol=1e-10)
    assert memory["angle_variance"] == pytest.approx(expected[n, n], rel=1e-10)


def test_a_recalled_constant_moves_what_is_known_of_the_angle() -> None:
    random = np.random.default_rng(3)
    n, row, noise = 6, 5, 0.4
    memory, whole = known(random, n)
    gain = random.standard_normal(n)
    recall_angle(memory, whole[:n, :n].copy(), row, gain, noise)
    k = np.concatenate([gain, [-memory["gradient"] @ gain[:4]]])
    rest = np.eye(n + 1) - np.outer(k, np.eye(n + 1)[row])
    expected = rest @ whole @ rest.T + noise * np.outer(k, k)
    np.testing.assert_allclose(memory["angle_cross"][:n], expected[:n, n], rtol=1e-10)
    assert memory["angle_variance"] == pytest.approx(expected[n, n], rel=1e-10)


def test_the_ideal_orbit_is_held_by_the_holding_force() -> None:
    """A device of any stiffness and damping under that force, by SciPy: it stays on the orbit, whose pattern turns by
    −W a unit of time.
    """
    rotation = 0.02
    names = ("phi_x", "phi_y", "rate", "kxx", "kyy", "kxy", "dxx", "dyy", "dxy")
    c = np.array([0.0, 0.0, 0.0, 1.05, 0.9, 0.02, 1e-2, 2e-2, 1e-3])
    assert len(names) == len(c)
    assert (names.index("phi_x"), names.index("rate")) == (PHI_X, RATE)

    def field(t: float, s: Array) -> list[float]:
        u, there = np.zeros((2, 1)), np.zeros(4)
        orbit(t, rotation, there)
        holding_force(c, there, rotation, u)
        x, vx, y, vy = s
        return [
            vx,
            u[0, 0] - c[3] * x - c[5] * y - c[6] * vx - c[8] * vy,
            vy,
            u[1, 0] - c[4] * y - c[5] * x - c[7] * vy - c[8] * vx,
        ]

    begin, end = np.zeros(4), np.zeros(4)
    orbit(0.0, rotation, begin)
    orbit(7.0, rotation, end)
    np.testing.assert_allclose(begin, [1.0, 0.0, 0.0, -rotation], atol=1e-15)
    found = solve_ivp(field, (0.0, 7.0), begin, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(found, end, atol=1e-8)
    double, energy, momentum = pattern(end, 1.0, rotation, 0.0)
    assert math.sin(double + 2 * rotation * 7.0) == pytest.approx(0.0, abs=1e-12)
    assert energy == pytest.approx(0.5 * (1.0 + rotation**2), rel=1e-12)
    assert momentum == pytest.approx(0.0, abs=1e-15)


@pytest.mark.moderate
@pytest.mark.parametrize(("angles", "phases"), [(4, 6), (6, 4)])
def test_gains_are_gathered_at_the_nearest_angle_and_phase(angles: int, phases: int) -> None:
    """Of an orbit whose pattern goes round: by (11) in NumPy, half a turn on with the phase half a cycle on. What
    settles it does not count; all cells together have the gains of a run that has a single one.
    """
    settle, samples = 3, 40
    runs = []
    for shape in ((angles, phases), (1, 1)):
        made = observer()
        a = made.arrays
        total, weight = np.zeros((*shape, 13, 2)), np.zeros(shape)
        Filter(a._replace(table=total)).gather(total, weight, rotation=0.12, h=0.7, settle=settle, samples=samples)
        runs.append((total, weight))
    expected, s = np.zeros((angles, phases)), np.zeros(4)
    for m in range(settle, settle + samples):
        orbit((m + 1) * 0.7, 0.12, s)
        x, vx, y, vy = s
        theta = 0.5 * math.atan2(2.0 * (x * y + vx * vy), x * x - y * y + vx * vx - vy * vy)
        along = complex(x * math.cos(theta) + y * math.sin(theta), -vx * math.cos(theta) - vy * math.sin(theta))
        phase = math.atan2(along.imag, along.real)
        cell = round((theta + 0.5 * math.pi) * angles / math.pi)
        if cell == angles:  # half a turn on is the same pattern, gone through from its other end
            cell, phase = 0, phase + math.pi
        expected[cell, round((phase + math.pi) * phases / (2.0 * math.pi)) % phases] += 1.0
    np.testing.assert_array_equal(runs[0][1], expected)
    assert np.all(expected.sum(axis=1) > 0.0)
    np.testing.assert_allclose(runs[0][0].sum(axis=(0, 1)), runs[1][0][0, 0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("latency", [0, 1, 3])
def test_a_virtual_rotation_turns_round_where_its_drive_acts(latency: int) -> None:
    """The drive computed from a sample acts `latency` samples on: its rotation is that of then, docs/decisions/
    0005-reported-angle.md: forward for half a period about zero, then back.
    """
    made = observer(virtual_rotation=0.02)
    settings, memory = made.arrays.settings[0], made.arrays.memory[0]
    settings["latency"], settings["reversal"] = latency, 40.0 * settings["h"]
    asked = []
    for sample in range(100):
        memory["time"] = sample * settings["h"]
        asked.append(acting(settings, memory) / float(settings["virtual_rate"]))
    expected = [-1.0 if math.floor((sample + latency + 0.5) / 40.0 + 0.5) % 2 else 1.0 for sample in range(100)]
    assert asked == pytest.approx(expected)
