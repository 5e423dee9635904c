"""Channels that show velocity or acceleration: free run and observer beside SciPy's solution of the same equation."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.effects.catalogue import effect_for
from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings, Sensed
from estimator.simulation import simulate
from evaluation.measured.refinement import refine
from tests.estimator.flow_pieces import Push, sensed_at, senses_otherwise
from tests.estimator.gyro_loop import Truth, free_motion
from tests.estimator.test_effects import base, values

RATE, K, D, B, K3, D3 = 400.0, (2 * np.pi * 20.0) ** 2, 2.5, 1.3, 6.0e8, 1.0e5
AMPLITUDE, SAMPLES = 1e-3, 1200


def device(sensed: Sensed, noise: float = 1e-6, stiffness: float = K, damping: float = D) -> Device:
    """A beam of 20 Hz whose sensor gives 1 V per m, m/s or m/s²."""
    return Device(
        sample_rate=RATE,
        stiffness=(stiffness,),
        damping=(damping,),
        amplitude=AMPLITUDE,
        sense_gain=(float(np.sqrt(stiffness)) ** sensed.value,),
        noise=(noise,),
        drive_gain=B,
        sensed=(sensed,),
    )


def truth(drive: Array, effects: bool) -> Array:
    """x, ẋ, ẍ (3, n) from SciPy under a drive that is held over each interval, from x = 1 mm, ẋ = 0.02 m/s."""
    k3, d3 = (K3, D3) if effects else (0.0, 0.0)

    def slope(_: float, state: Array, u: float) -> Array:
        x, v = state
        return np.array([v, -K * x - D * v - k3 * x**3 - d3 * x**2 * v + B * u])

    state, rows = np.array([1e-3, 0.02]), []
    for m, u in enumerate(drive):
        if m:
            solved = solve_ivp(slope, (0.0, 1.0 / RATE), state, "DOP853", args=(u,), rtol=1e-11, atol=1e-15)
            state = solved.y[:, -1]
        rows.append([*state, slope(0.0, state, u)[1]])
    return np.array(rows).T


@pytest.fixture(scope="module")
def drive() -> Array:
    """Noise of 3 m/s², held."""
    return np.random.default_rng(3).normal(0.0, 3.0, SAMPLES)


@pytest.mark.beyond(4)
@pytest.mark.slow
@pytest.mark.parametrize("sensed", list(Sensed))
@pytest.mark.parametrize("effects", [False, True])
def test_free_run_shows_what_scipy_computes(sensed: Sensed, effects: bool, drive: Array) -> None:
    carried = {"cubic_stiffness": {"k3x": K3}, "nonlinear_damping": {"d3x": D3}} if effects else {}
    seen = truth(drive, effects)[sensed.value]
    observer = Observer(device(sensed), ObserverSettings(gain=Gain.EKF, effects=carried))
    state = observer.state.copy()
    state[:2] = 1e-3, 0.02
    ran = simulate(observer, state, drive[:, None])
    error = np.abs(ran.sensed[1:, 0] - seen[1:]) / np.max(np.abs(seen))
    assert np.max(error) < (2e-5 if effects else 1e-9)


@pytest.mark.moderate
@pytest.mark.parametrize("sensed", list(Sensed))
def test_derivatives_are_those_of_differences(sensed: Sensed, drive: Array) -> None:
    carried: dict[str, dict[str, float]] = {
        "cubic_stiffness": {"k3x": K3},
        "nonlinear_damping": {"d3x": D3},
        "sense_quadratic": {"a2x": 20.0},
        "drive_feedthrough": {"fdx": 1e-7},
    }
    observer = Observer(device(sensed), ObserverSettings(gain=Gain.EKF, effects=carried))
    state = observer.state.copy()
    state[:2] = 1e-3, 0.02
    driven = drive[:300, None]
    exact = simulate(observer, state, driven, sensitive=True).sensitivity[1:, 0]
    for i, name in enumerate(observer.names):
        size = {"phi_x": 1e-3, "fdx": 1e-8}.get(name, 1e-5 * max(abs(state[i]), 1e-6))
        low, high = (simulate(observer, state + sign * size * np.eye(len(state))[i], driven) for sign in (-1, 1))
        by_differences = (high.sensed - low.sensed)[1:, 0] / (2 * size)
        assert np.max(np.abs(exact[:, i] - by_differences)) < 1e-4 * np.max(np.abs(by_differences)), name


@pytest.mark.moderate
@pytest.mark.parametrize("sensed", [Sensed.VELOCITY, Sensed.ACCELERATION])
def test_a_noisy_record_gives_back_its_constants(sensed: Sensed, drive: Array) -> None:
    seen = truth(drive, True)[sensed.value]
    noise = 1e-3 * float(np.std(seen))
    sense = (seen + np.random.default_rng(5).normal(0.0, noise, SAMPLES))[:, None]
    sense[0] = np.nan  # no drive acts at the first sample: what it shows of an acceleration is unknown
    settings = ObserverSettings(gain=Gain.EKF, effects={"cubic_stiffness": {}, "nonlinear_damping": {}})
    observer = Observer(device(sensed, noise, 1.01 * K, 1.2 * D), settings)
    start = observer.state.copy()
    fit = refine(observer, sense, drive[:, None], start=start)
    for name, true in {"kxx": K, "dxx": D, "drive_gain_x": B, "k3x": K3, "d3x": D3, "x": 1e-3, "vx": 0.02}.items():
        low, high = fit.interval(name)
        half = (high - low) / 2
        assert abs(fit.value(name) - true) < 2 * half, name
        assert half < 0.2 * abs(true), name
    assert fit.rmse[0] == pytest.approx(noise, rel=0.1)


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize("sensed", [Sensed.VELOCITY, Sensed.ACCELERATION])
def test_the_observer_follows_and_its_innovation_is_the_noise(sensed: Sensed, drive: Array) -> None:
    seen = truth(drive, True)[sensed.value]
    noise = 1e-3 * float(np.std(seen))
    sense = (seen + np.random.default_rng(7).normal(0.0, noise, SAMPLES))[:, None]
    carried = {"cubic_stiffness": {"k3x": K3}, "nonlinear_damping": {"d3x": D3}}
    observer = Observer(device(sensed, noise), ObserverSettings(gain=Gain.EKF, effects=carried))
    estimates = observer.run(sense, drive[:, None])
    late = estimates.innovation[SAMPLES // 2 :, 0]
    assert np.std(late) == pytest.approx(noise, rel=0.15)
    assert np.std(estimates.of("x")[SAMPLES // 2 :] - truth(drive, True)[0, SAMPLES // 2 :]) < 2e-3 * AMPLITUDE


def test_what_is_known_of_a_displacement_only_is_refused() -> None:
    with pytest.raises(ModelError, match="displacement only"):
        Observer(device(Sensed.VELOCITY), ObserverSettings(effects={"sense_delay": {}}))


def shown(sensed: Sensed, c: Array, s: Array, u: float) -> tuple[float, Array, Array]:
    """What the channel shows at one state under phi, k, d, b, k3, d3 and a2, and its derivatives by both; scaled."""
    carried: dict[str, dict[str, float]] = {"cubic_stiffness": {}, "nonlinear_damping": {}, "sense_quadratic": {}}
    made = Observer(device(sensed), ObserverSettings(gain=Gain.EKF, effects=carried))
    assert made.names[2:] == ("phi_x", "kxx", "dxx", "drive_gain_x", "k3x", "d3x", "a2x")
    settings = made.arrays.settings[0]
    push = Push(2, len(made.x) - 2)
    push.drive[0] = u
    predicted, full = np.zeros(2), np.full((2, 9), 9.0)
    assert bool(senses_otherwise(settings)) is (sensed is not Sensed.DISPLACEMENT)
    sensed_at(settings, c, s, push, predicted, full)
    return predicted[0], full[0, :2], full[0, 2:]


@pytest.mark.parametrize("sensed", list(Sensed))
def test_a_channel_shows_the_equation_at_any_one_state(sensed: Sensed) -> None:
    """x, ẋ or ẍ of the whole equation, effects included, beside offset and square of it; derivatives by differences."""

    def formula(c: Array, s: Array) -> float:
        phi, k, d, b, k3, d3, a2 = c
        x, v = s
        q = (x, v, -k * x - d * v - k3 * x**3 - d3 * x**2 * v + b * 0.7)[sensed.value]
        return float(q + phi + a2 * q**2)

    c, s = np.array([0.05, 1.1, 0.2, 0.9, 0.3, 0.15, 0.4]), np.array([0.8, -0.4])
    value, by_states, by_constants = shown(sensed, c, s, 0.7)
    assert value == pytest.approx(formula(c, s), rel=1e-9)
    for place, found in ((s, by_states), (c, by_constants)):
        for i, derivative in enumerate(found):
            step = 1e-6 * np.eye(len(place))[i]
            ends = [formula(c + sign * step, s) if place is c else formula(c, s + sign * step) for sign in (1, -1)]
            assert derivative == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-8), (i, len(place))


BOTH_AXES: tuple[str, ...] = ("cubic_stiffness", "nonlinear_damping", "sense_cross_coupling", "sense_low_pass")


@cache
def of_two(name: str, what: str) -> Callable[..., Array]:
    """`values` of an effect of two axes, made once: it is asked for every derivative."""
    return values(effect_for(name, 2)[1], what)


def seen_of_two(made: Observer, sensed: tuple[int, int], c: Array, s: Array, u: Array) -> Array:
    """What channels of two axes show, from the declarations alone: q and its rate in the place of a displacement and
    its velocity, of an acceleration the rate that the linear part has along the whole slope.
    """
    constants, first, pushed = c[:9], 9, np.zeros(2)
    parts = []
    for _, effect in made.effects:
        own = c[first : first + len(effect.coefficients)]
        first += len(effect.coefficients)
        parts.append((effect, own))
    for effect, own in parts:
        if any(one != 0 for one in effect.force):
            pushed = pushed + of_two(effect.name, "force")(s, u, own, 0.0, constants)
    slope = base(c, s, u) + np.array([0.0, pushed[0], 0.0, pushed[1]])
    q = s.copy()
    for axis, kind in enumerate(sensed):
        row = 2 * axis
        if kind == 1:
            q[row : row + 2] = s[row + 1], slope[row + 1]
        elif kind == 2:
            q[row : row + 2] = slope[row + 1], free_motion(*c[2:9])[row + 1] @ slope
    shown = q[[0, 2]] + c[:2]
    for effect, own in parts:
        if any(one != 0 for one in effect.sense):
            shown = shown + of_two(effect.name, "sense")(q, u, own, 0.0, constants)
    return np.asarray(shown)


@pytest.mark.moderate
@pytest.mark.parametrize("sensed", [(1, 0), (0, 1), (2, 1), (1, 2), (2, 2)])
def test_rows_of_two_axes_with_velocity_effects_equal_differences(sensed: tuple[int, int]) -> None:
    """A low-pass takes the rate of what is shown, a cross-coupling what the other channel shows: every row of the
    derivatives that the sense chain is given counts.
    """
    made = Observer(Truth().device(), ObserverSettings(gain=Gain.EKF, effects={name: {} for name in BOTH_AXES}))
    settings = made.arrays.settings[0]
    settings["sensed"] = sensed
    assert senses_otherwise(settings)
    push = Push(4, len(made.x) - 4)
    push.signals[:] = 0.3  # as `values` has what memory holds
    u = np.array([0.7, -0.4])
    push.drive[:] = u
    s = np.array([0.8, -0.4, 0.3, 0.6])
    c = np.array([0.05, -0.03, 0.15, 1.1, 0.9, 0.07, 0.2, 0.3, 0.1, *0.1 * np.arange(2.0, 2.0 + len(made.x) - 13)])
    predicted, full = np.zeros(2), np.full((2, 4 + len(c)), 9.0)
    sensed_at(settings, c, s, push, predicted, full)
    by_states, by_constants = np.hsplit(full, [4])
    np.testing.assert_allclose(predicted, seen_of_two(made, sensed, c, s, u), rtol=1e-10)
    for place, found in ((s, by_states), (c, by_constants)):
        for i in range(len(place)):
            step = 1e-6 * np.eye(len(place))[i]
            ahead, behind = (
                seen_of_two(made, sensed, c + side * step, s, u)
                if place is c
                else seen_of_two(made, sensed, c, s + side * step, u)
                for side in (1.0, -1.0)
            )
            np.testing.assert_allclose(found[:, i], (ahead - behind) / 2e-6, atol=1e-7, err_msg=f"{i} of {len(place)}")
    assert np.all(np.abs(by_states).max(axis=0) > 1e-3)
