"""Free runs beside an independent integrator, their derivatives beside differences, and fits beside the truth."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval
from scipy.integrate import solve_ivp

from estimator.errors import ModelError
from estimator.hold import drive_polynomials
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings, Sensed, Spread
from estimator.simulation import simulate
from evaluation.measured.refinement import refine
from tests.estimator.driven_axis import state_of

RATE = 600.0
SINGLE = Device(
    sample_rate=RATE,
    stiffness=(1.9e5,),
    damping=(40.0,),
    amplitude=0.1,
    sense_gain=(2.0,),
    noise=(1e-4,),
)
GYRO = Device(
    sample_rate=4000.0,
    stiffness=(1.6e6, 1.55e6, 1e4),
    damping=(2.0, 2.2, 0.1),
    amplitude=1e-4,
    sense_gain=(-890.0, -900.0),
    noise=(1e-4, 1e-4),
)


def noise_drive(samples, axes, size):
    return size * np.random.default_rng(3).standard_normal((samples, axes))


def integrated(field, start, steps):
    """States at the samples: each interval by DOP853, field(m, seconds into it, state)."""
    states = [np.array(start)]
    for m in range(1, len(steps)):
        solution = solve_ivp(
            lambda t, s, m=m: field(m, t, s), (0.0, steps[m]), states[-1], method="DOP853", rtol=1e-11, atol=1e-14
        )
        states.append(solution.y[:, -1])
    return np.array(states)


@pytest.mark.moderate
def test_a_driven_single_axis_agrees_with_an_independent_integrator():
    observer = Observer(SINGLE, ObserverSettings(effects={"cubic_stiffness": {}, "nonlinear_damping": {}}))
    state = state_of(observer, x=0.02, vx=-3.0, phi_x=0.01, k3x=7e5, d3x=120.0, drive_gain_x=1.1)
    drive = noise_drive(60, 1, 1e4)
    polynomials = drive_polynomials(drive, "foh")
    steps = np.random.default_rng(4).uniform(0.7, 1.3, 60) / RATE

    def field(m, t, s):
        force = np.polyval(polynomials[m, 0][::-1], t / steps[m])
        return [s[1], 1.1 * force - 40.0 * s[1] - 1.9e5 * s[0] - 7e5 * s[0] ** 3 - 120.0 * s[0] ** 2 * s[1]]

    expected = 2.0 * integrated(field, (0.02, -3.0), steps)[:, 0] + 0.01
    sensed = simulate(observer, state, polynomials, step=steps).sensed[:, 0]
    assert np.max(np.abs(sensed - expected)) < 3e-6 * np.max(np.abs(expected))


@pytest.mark.moderate
@pytest.mark.parametrize(("sensed", "order"), [(Sensed.VELOCITY, 1), (Sensed.ACCELERATION, 2)])
def test_a_channel_of_velocity_or_acceleration_shows_that(sensed, order):
    observer = Observer(replace(SINGLE, sensed=(sensed,)), ObserverSettings())
    state = state_of(observer, x=0.02, vx=-3.0, phi_x=0.01)
    drive = noise_drive(60, 1, 1e4)

    def field(m, t, s):
        return [s[1], drive[m, 0] - 40.0 * s[1] - 1.9e5 * s[0]]

    steps = np.full(60, 1.0 / RATE)
    moved = integrated(field, (0.02, -3.0), steps)
    shown = np.column_stack([moved, [field(m, 0.0, s)[1] for m, s in enumerate(moved)]])[:, order]
    shown *= SINGLE.stiffness[0] ** (-0.5 * order)  # the gain is that of a vibration at the resonance
    found = simulate(observer, state, drive).sensed[:, 0]
    assert np.max(np.abs(found - 2.0 * shown - 0.01)) < 1e-5 * np.max(np.abs(shown))


def test_a_rotating_two_axis_gyro_runs_as_an_independent_integrator_says():
    observer = Observer(GYRO, ObserverSettings())
    state = state_of(observer, x=1e-4, vy=0.01, rate=5.0, phi_y=1e-3)
    drive = noise_drive(40, 2, 2.0)

    def field(m, t, s):
        x, vx, y, vy = s
        w = 5.0
        return [
            vx,
            drive[m, 0] - 2.0 * vx - 0.1 * vy - 1.6e6 * x - 1e4 * y + 2 * w * vy + w * w * x,
            vy,
            drive[m, 1] - 0.1 * vx - 2.2 * vy - 1e4 * x - 1.55e6 * y - 2 * w * vx + w * w * y,
        ]

    states = integrated(field, (1e-4, 0.0, 0.0, 0.01), np.full(40, 1 / 4000.0))
    expected = np.column_stack([-890.0 * states[:, 0], -900.0 * states[:, 2] + 1e-3])
    assert np.max(np.abs(simulate(observer, state, drive).sensed - expected)) < 1e-9


@pytest.mark.moderate
def test_derivatives_are_those_of_differences():
    effects = {"cubic_stiffness": {}, "nonlinear_damping": {}, "sense_quadratic": {}, "drive_feedthrough": {}}
    observer = Observer(SINGLE, ObserverSettings(effects=effects))
    state = state_of(observer, x=0.02, vx=5.0, k3x=7e5, d3x=120.0, a2x=0.05, fdx=1e-7)
    drive = noise_drive(80, 1, 1e4)
    derivative = simulate(observer, state, drive, sensitive=True).sensitivity
    for i, factor in enumerate(observer.factors):
        nudge = np.zeros(len(state))
        nudge[i] = 1e-5 * abs(factor)
        ahead, behind = (simulate(observer, state + sign * nudge, drive).sensed for sign in (1.0, -1.0))
        difference = (ahead - behind) / (2.0 * nudge[i])
        assert np.max(np.abs(derivative[:, :, i] - difference)) < 1e-5 * np.max(np.abs(difference)), observer.names[i]


@pytest.fixture(scope="module")
def refined():
    """A record made by an independent integrator with white noise, and its refinement from the declared values."""
    rng = np.random.default_rng(11)
    drive = noise_drive(1500, 1, 1e4)
    steps = np.full(1500, 1.0 / RATE)
    truth = {"x": 0.01, "vx": 1.0, "phi_x": 0.004, "kxx": 1.93e5, "dxx": 43.0, "k3x": 7.3e5, "drive_gain_x": 0.95}

    def field(m, t, s):
        force = truth["drive_gain_x"] * drive[m, 0]
        return [s[1], force - truth["dxx"] * s[1] - truth["kxx"] * s[0] - truth["k3x"] * s[0] ** 3]

    states = integrated(field, (truth["x"], truth["vx"]), steps)
    sense = 2.0 * states[:, :1] + truth["phi_x"] + 1e-4 * rng.standard_normal((1500, 1))
    sense[700] = np.nan
    observer = Observer(SINGLE, ObserverSettings(effects={"cubic_stiffness": {}}, spread=Spread(offset=0.01)))
    return truth, refine(observer, sense, drive)


@pytest.mark.moderate
def test_refinement_finds_the_truth_within_its_intervals(refined):
    truth, fit = refined
    for name, value in truth.items():
        deviation = fit.deviation[fit.names.index(name)]
        assert 0.0 < deviation < 0.01 * max(abs(value), 0.01 * abs(fit.value("kxx"))), name
        assert abs(fit.value(name) - value) < 3.5 * deviation, name
    assert fit.rmse[0] == pytest.approx(1e-4, rel=0.06)


def test_what_is_not_free_stays():
    observer = Observer(SINGLE, ObserverSettings())
    drive = noise_drive(50, 1, 1e4)
    sense = simulate(observer, state_of(observer, x=0.03, vx=2.0), drive).sensed
    fit = refine(observer, sense, drive, free=("x", "vx"))
    assert (fit.value("x"), fit.value("vx")) == pytest.approx((0.03, 2.0), rel=1e-6)
    np.testing.assert_array_equal(fit.state[2:], observer.state[2:])
    np.testing.assert_array_equal(fit.deviation[2:], 0.0)


@pytest.mark.moderate
def test_a_coloured_residual_widens_the_intervals():
    observer = Observer(SINGLE, ObserverSettings())
    drive = noise_drive(3000, 1, 1e4)
    clean = simulate(observer, state_of(observer, x=0.03), drive).sensed
    white = np.random.default_rng(5).standard_normal(3000)
    coloured = np.convolve(white, np.ones(30) / np.sqrt(30.0), mode="same")
    widths = [
        refine(observer, clean + 1e-3 * noise[:, None], drive).deviation[observer.names.index("phi_x")]
        for noise in (white, coloured)
    ]
    assert widths[0] == pytest.approx(1e-3 / np.sqrt(3000), rel=0.3)
    assert widths[1] == pytest.approx(np.sqrt(30.0) * widths[0], rel=0.4)


def test_bad_requests_are_refused():
    observer = Observer(SINGLE, ObserverSettings())
    drive = np.zeros((30, 1))
    with pytest.raises(ModelError, match="expected 6: x, vx"):
        simulate(observer, np.zeros(3), drive)
    with pytest.raises(ModelError, match="step has 2 rows, drive has 30"):
        simulate(observer, observer.state, drive, step=np.ones(2))
    with pytest.raises(ModelError, match="leaves all bounds at sample"):
        simulate(observer, state_of(observer, x=0.01, dxx=-400.0), np.zeros((3000, 1)))
    with pytest.raises(ModelError, match="nothing named k3x"):
        refine(observer, np.zeros((30, 1)), drive, free=("k3x",))
    with pytest.raises(ModelError, match="3 samples for 6 unknowns"):
        refine(observer, np.zeros((3, 1)), drive[:3])


@pytest.mark.parametrize("rate", [600.0, 4000.0])
def test_a_free_run_keeps_the_time_of_forces_and_of_what_is_sensed(rate: float) -> None:
    """A base that shakes, a line in the sensed signal, a feedthrough of the drive at the end of each interval; each
    step in three parts, and whole.
    """
    device = Device(
        sample_rate=rate, stiffness=(1.9e5,), damping=(40.0,), amplitude=0.1, sense_gain=(2.0,), noise=(1e-4,)
    )
    shaken, line, through = (900.0, -500.0), (0.01, 0.03), 2e-6
    omega, other = 310.0, 170.0
    effects: dict[str, dict[str, float]] = {
        "base_vibration": {"omega": omega},
        "interference": {"omega": other},
        "drive_feedthrough": {},
    }
    observer = Observer(device, ObserverSettings(effects=effects))
    state = observer.state.copy()
    at = {"x": 0.02, "vx": -3.0, "bcx": shaken[0], "bsx": shaken[1], "lcx": line[0], "lsx": line[1], "fdx": through}
    for name, value in at.items():
        state[observer.names.index(name)] = value
    n, random = 25, np.random.default_rng(4)
    drive = 1e4 * random.standard_normal((n, 1, 2))
    steps = random.uniform(0.7, 1.3, n) / rate
    found = simulate(observer, state, drive, step=steps).sensed[:, 0]
    motion, time = np.array([0.02, -3.0]), 0.0
    for m in range(n):
        if m:

            def field(t: float, s: Array, m: int = m, time: float = time) -> list[float]:
                push = shaken[0] * math.cos(omega * (time + t)) + shaken[1] * math.sin(omega * (time + t))
                return [s[1], polyval(t / steps[m], drive[m, 0]) + push - 40.0 * s[1] - 1.9e5 * s[0]]

            motion = solve_ivp(field, (0.0, steps[m]), motion, "DOP853", rtol=1e-11, atol=1e-14).y[:, -1]
            time += steps[m]
        own = line[0] * math.cos(other * time) + line[1] * math.sin(other * time)
        shown = motion[0] + own + through * drive[m, 0].sum()
        assert found[m] == pytest.approx(2.0 * shown, abs=2e-7), m
