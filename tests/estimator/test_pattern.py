"""Sign, unwrapping and turn counting of the angle, on an ideal oscillator by solve_ivp (docs/explanation.md)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from estimator.observer import Observer
from estimator.oracle.pattern import pattern as complex_pattern
from estimator.oracle.pattern import pattern_gradient
from estimator.settings import Gain, ObserverSettings, Spread
from tests.estimator.core_pieces import pattern, unwrap_half_turns
from tests.estimator.gyro_loop import Array, Truth


def ideal_motion(rate: float, centrifugal: float, samples: int, h: float) -> Array:
    """States (samples, 4) of (10), ẍ + x = 2Ωẏ, ÿ + y = −2Ωẋ, with Ω²(x, y) on the right as well where it is real."""

    def field(_: float, s: Array) -> list[float]:
        x, vx, y, vy = s
        return [vx, 2 * rate * vy + (centrifugal - 1.0) * x, vy, -2 * rate * vx + (centrifugal - 1.0) * y]

    # Released from rest in the frame in which the pattern rests, so that it is a line there.
    start = [np.cos(0.2), rate * np.sin(0.2), np.sin(0.2), -rate * np.cos(0.2)]
    t = np.arange(samples) * h
    return solve_ivp(field, (0.0, t[-1]), start, method="DOP853", t_eval=t, rtol=1e-12, atol=1e-12).y.T


def angles(states: Array, w: float, rate: float) -> Array:
    """θ of each state by the kernel's formula, unwrapped and turns counted by the kernel."""
    theta = [0.2]
    for s in states:
        theta.append(unwrap_half_turns(pattern(s, 1.0, w, rate)[0], theta[-1]))
    return np.array(theta[1:])


@pytest.mark.slow
@pytest.mark.parametrize("rate", [3e-2, -3e-2])
def test_corrected_formula_is_exact_and_the_pattern_lags_the_board(rate: float) -> None:
    h, samples = 0.3, 2200  # three turns
    states = ideal_motion(rate, 0.0, samples, h)
    turned = rate * h * np.arange(samples)
    np.testing.assert_allclose(angles(states, rate, 0.0), 0.2 - turned, atol=1e-8)


@pytest.mark.moderate
def test_real_rotation_brings_its_centrifugal_term_along() -> None:
    rate, h, samples = 3e-2, 0.3, 1000
    states = ideal_motion(rate, rate**2, samples, h)
    turned = rate * h * np.arange(samples)
    np.testing.assert_allclose(angles(states, rate, rate), 0.2 - turned, atol=1e-8)
    momentum = [pattern(s, 1.0, rate, rate)[2] for s in states]
    energy = [pattern(s, 1.0, rate, rate)[1] for s in states]
    np.testing.assert_allclose(momentum, 0.0, atol=1e-9)
    np.testing.assert_allclose(energy, 0.5, atol=1e-9)


@pytest.mark.moderate
def test_plain_formula_ripples_at_twice_the_vibration_by_half_the_rotation() -> None:
    rate, h, samples = 3e-2, 0.3, 1500
    turned = rate * h * np.arange(samples)
    error = angles(ideal_motion(rate, 0.0, samples, h), 0.0, 0.0) - 0.2 + turned
    t = h * np.arange(samples)
    line = 2.0 * np.mean(error * np.exp(-2j * t))
    assert np.max(np.abs(error)) == pytest.approx(rate / 2, rel=0.05)
    assert abs(line) == pytest.approx(rate / 2, rel=0.05)


@pytest.mark.moderate
@given(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
def test_unwrapping_finds_the_nearest_half_turn(double: float, before: float) -> None:
    theta = unwrap_half_turns(double, before)
    assert abs(theta - before) <= np.pi / 2 + 1e-9
    assert abs((theta - 0.5 * double) / np.pi - round((theta - 0.5 * double) / np.pi)) < 1e-9


@pytest.mark.moderate
@given(st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_the_complex_form_says_the_same(s: list[float], w: float, rate: float) -> None:
    double, energy, momentum = pattern(np.array(s), 1.0, w, rate)
    other, other_energy, other_momentum = (x[0] for x in complex_pattern(np.array([s]), 1.0, w, rate))
    turning = complex(s[1], s[3]) + 1j * w * complex(s[0], s[2])
    stiffness = 1.0 + w * w - rate * rate
    slender = abs(stiffness * complex(s[0], s[2]) ** 2 + turning**2)  # 0 for a circle, which has no angle
    assert abs(np.exp(1j * double) - np.exp(1j * other)) * slender < 1e-12
    assert energy == pytest.approx(other_energy, abs=1e-12)
    assert momentum == pytest.approx(other_momentum, abs=1e-12)


def test_gradient_of_the_angle_is_that_of_finite_differences() -> None:
    s, virtual, rate, d = np.array([0.6, -0.3, 0.5, 0.2]), 5e-2, 1e-2, 1e-6
    found = pattern_gradient(s, 1.0, rate + virtual, rate)
    for entry in range(5):
        step = d * np.eye(5)[entry]
        ends = [
            0.5 * pattern(s + sign * step[:4], 1.0, rate + sign * step[4] + virtual, rate + sign * step[4])[0]
            for sign in (1.0, -1.0)
        ]
        assert found[entry] == pytest.approx((ends[0] - ends[1]) / (2 * d), abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_reported_rotation_is_plus_the_integral_of_the_rate_over_turns(sign: float) -> None:
    """φ = +∫Ω dt, from the volts of an ideal board, without drive; three turns and a half."""
    truth = Truth(stiffness=(1.0, 1.0, 0.0), damping=(0.0, 0.0, 0.0), offset=(0.0, 0.0))
    rate, samples = sign * 0.02, 3500
    states = ideal_motion(rate, rate**2, samples, truth.omega0 / truth.sample_rate)
    volts = truth.sense_gain * truth.amplitude * states[:, [0, 2]]
    volts += np.random.default_rng(1).standard_normal(volts.shape) * truth.noise
    settings = ObserverSettings(gain=Gain.EKF, spread=Spread(rate=30.0))
    found = Observer(truth.device(), settings).run(volts, np.zeros((samples, 2)))
    turned = rate * np.arange(samples) * truth.omega0 / truth.sample_rate
    begin = 500
    assert abs(turned[-1]) > 6 * np.pi
    for angle, limit in (
        (found.angle, 2e-3),
        (found.angle_pattern, 2e-3),
        (found.angle_plain, abs(rate)),
        (found.angle_rate_integral, 2e-3),
    ):
        error = (angle - angle[begin]) - (turned - turned[begin])
        assert np.max(np.abs(error[begin:])) < limit
