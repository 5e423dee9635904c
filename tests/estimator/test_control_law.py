"""The pieces of the control law and of the reported angle, each beside what it stands for, written out."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.core.layout import RATE
from estimator.observer import Observer
from estimator.settings import ObserverSettings
from tests.estimator.core_pieces import (
    acting,
    command,
    control_law,
    correct_angle,
    holds,
    recall_angle,
    undo_effects,
    workspace,
)
from tests.estimator.gyro_loop import Array, Truth

TRUTH = Truth()


def observer(effects: dict[str, dict[str, float]] | None = None, **control: object) -> Observer:
    settings = ObserverSettings(effects=effects or {})
    return Observer(TRUTH.device(), settings, TRUTH.controller(**control))


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
    """Inverted, a gain error g leaves (1 + g) f, and a spring's k3 x³ is cancelled: what acts is what was asked for."""
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


def known(random: np.random.Generator, n: int) -> tuple[Any, Array]:
    """An observer's memory of an angle that depends on its state by a drawn gradient, and the covariance
    (n + 1, n + 1) of state and angle together."""
    root = random.standard_normal((n + 1, n + 1))
    whole = root @ root.T
    memory = observer().arrays.memory[0]
    memory["gradient"][:n] = random.standard_normal(n)
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
    k = np.vstack([gain, -memory["gradient"][:n] @ gain])[:, :channels]
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
    k = np.concatenate([gain, [-memory["gradient"][:n] @ gain]])
    rest = np.eye(n + 1) - np.outer(k, np.eye(n + 1)[row])
    expected = rest @ whole @ rest.T + noise * np.outer(k, k)
    np.testing.assert_allclose(memory["angle_cross"][:n], expected[:n, n], rtol=1e-10)
    assert memory["angle_variance"] == pytest.approx(expected[n, n], rel=1e-10)


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
