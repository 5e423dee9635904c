"""What effects depend on beside the motion, from sample to sample: each signal beside its definition or SciPy's
solution of its equation; and the time that a free run keeps.
"""

import math

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval
from scipy.integrate import solve_ivp

from estimator.core.layout import MAX_SIGNALS
from estimator.effects.declaration import Source
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from estimator.simulation import simulate
from tests.estimator.flow_pieces import advance_signals, lagged, leaking, line_values, signal_values, turns_over
from tests.estimator.gyro_loop import Truth

DRIVE = np.array([[0.4, -0.3, 0.2, 0.5], [-0.2, 0.6, 0.1, -0.4]])
"""Of two axes, four terms of a polynomial each."""
KINDS = [
    (Source.PARAMETER, 0, -1),
    (Source.COSINE, 0, -1),
    (Source.INTEGRAL, 1, -1),
    (Source.SINE, 0, -1),
    (Source.TEMPERATURE, 0, -1),
    (Source.DECAY, 1, -1),
    (Source.LAG, 1, 10),
    (Source.DIRECTION, 1, -1),
    (Source.TIME, 0, -1),
    (Source.WANE, 0, 9),
    (Source.RESONATOR, 1, -1),
    (Source.DECAY, 0, -1),
    (Source.LAG, 0, 9),
]
FIRST = np.array([0.7, 1.3, 0.4, 0.9, 0.2, 0.6, 0.3, 0.05, 0.8, 0.1, 1.7, 0.25, 0.35])
SECOND = np.array([0.9, 0.3, 0.1, 0.7, 0.6, 0.15, 0.2, 0.4, 0.5, 0.45, 0.02, 0.55, 0.65])


def listed() -> Observer:
    """An observer of two axes whose signals are those above, with two parameters each; memory holds other numbers."""
    made = Observer(Truth().device(), ObserverSettings())
    settings, memory = made.arrays.settings[0], made.arrays.memory[0]
    count = len(KINDS)
    settings["signals"][:count] = [(source.value, axis, behind) for source, axis, behind in KINDS]
    settings["signal_parameters"][:count, 0], settings["signal_parameters"][:count, 1] = FIRST, SECOND
    settings["signal_count"] = count
    memory["signals"][:count, 0] = 0.1 + 0.01 * np.arange(count)
    memory["signals"][:count, 1] = -0.2 + 0.03 * np.arange(count)
    memory["temperature"], memory["time"] = 4.5, 2.1
    return made


def test_signals_of_time_are_their_definitions() -> None:
    made, found = listed(), np.full(2 * MAX_SIGNALS, 9.0)
    line_values(made.arrays.settings[0], 2.6, found)
    expected = np.full(2 * MAX_SIGNALS, 9.0)
    expected[1], expected[3], expected[8] = math.cos(1.3 * 2.6), math.sin(0.9 * 2.6), 2.6
    expected[5], expected[11] = math.exp(-0.15 * 2.6), math.exp(-0.25 * 2.6)  # each at the rate of its own axis
    np.testing.assert_allclose(found, expected, rtol=1e-14)
    assert [bool(turns_over(made.arrays.settings[0], i)) for i in range(13)] == [i == 7 for i in range(13)]


def test_other_signals_are_what_memory_holds() -> None:
    made, found = listed(), np.full(2 * MAX_SIGNALS, 9.0)
    signal_values(made.arrays.settings[0], made.arrays.memory[0], 2.6, found)
    expected = np.full(2 * MAX_SIGNALS, 9.0)
    expected[:13] = 0.1 + 0.01 * np.arange(13)
    expected[0], expected[4] = 0.7, 4.5
    line_values(made.arrays.settings[0], 2.6, expected)
    np.testing.assert_allclose(found, expected, rtol=1e-14)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("share", [0.02, 0.4, 3.0])
def test_a_lag_is_that_of_an_integrator(axis: int, share: float) -> None:
    """T q̇ = u − q over one interval of length 1."""
    solved = solve_ivp(
        lambda t, q: (polyval(t, DRIVE[axis]) - q) / share, (0.0, 1.0), [0.7], "DOP853", rtol=1e-11, atol=1e-13
    )
    assert lagged(0.7, DRIVE, axis, share) == pytest.approx(solved.y[0, -1], abs=1e-10)


@pytest.mark.parametrize("share", [0.0, -0.3])
def test_without_a_lag_the_drive_is_that_at_the_end(share: float) -> None:
    assert lagged(0.7, DRIVE, 1, share) == pytest.approx(DRIVE[1].sum(), rel=1e-14)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("rate", [0.0, 0.3, 4.9, 5.1, 9.0])
def test_an_integral_that_leaks_is_that_of_an_integrator(axis: int, rate: float) -> None:
    """q̇ = u − a q over 0.4, of which u is a polynomial; the leak of an interval is below 2 and above."""
    h = 0.4
    solved = solve_ivp(
        lambda t, q: polyval(t / h, DRIVE[axis]) - rate * q, (0.0, h), [0.7], "DOP853", rtol=1e-12, atol=1e-14
    )
    assert leaking(0.7, DRIVE, axis, rate, h) == pytest.approx(solved.y[0, -1], abs=1e-11)


def test_recursions_go_on_by_an_interval_and_what_has_none_stays() -> None:
    made, h = listed(), 0.35
    settings, memory = made.arrays.settings[0], made.arrays.memory[0]
    c = np.zeros(11)
    c[9], c[10] = 0.5, 0.15
    before = memory["signals"].copy()
    expected = before.copy()
    expected[2, 0] = leaking(before[2, 0], DRIVE, 1, 0.4, h)
    expected[6, 0] = lagged(before[6, 0], DRIVE, 1, 0.15 / h)
    expected[12, 0] = lagged(before[12, 0], DRIVE, 0, 0.5 / h)
    expected[9, 0] = math.exp(-(2.1 + h) / 0.5)
    mean = float(np.mean(polyval(0.5 + 0.5 * np.polynomial.legendre.leggauss(3)[0], DRIVE[1])[:, None], axis=1) @ [
        5 / 18, 8 / 18, 5 / 18,
    ])  # fmt: skip

    def ringing(_: float, s: Array) -> list[float]:
        return [s[1], mean - 2.0 * 0.02 * 1.7 * s[1] - 1.7**2 * s[0]]

    expected[10] = solve_ivp(ringing, (0.0, h), before[10], "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    advance_signals(settings, memory, c, DRIVE, h)
    np.testing.assert_allclose(memory["signals"], expected, rtol=1e-9, atol=1e-12)
    for lag in (0.0, -0.5):  # no time to wane in
        c[9] = lag
        advance_signals(settings, memory, c, DRIVE, h)
        assert memory["signals"][9, 0] == 0.0


def test_signals_of_an_axis_that_is_not_there_stay() -> None:
    made = listed()
    settings, memory = made.arrays.settings[0], made.arrays.memory[0]
    settings["axes"] = 1
    before, c = memory["signals"].copy(), np.full(11, 0.5)
    advance_signals(settings, memory, c, DRIVE[:1], 0.35)
    stays = [source in (Source.INTEGRAL, Source.LAG, Source.RESONATOR) and axis == 1 for source, axis, _ in KINDS]
    assert sum(stays) == 3
    np.testing.assert_array_equal(memory["signals"][:13][stays], before[:13][stays])
    assert memory["signals"][12, 0] != before[12, 0]


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
