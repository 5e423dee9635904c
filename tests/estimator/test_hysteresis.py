"""A spring that slips: its free run beside an integrator of Bouc and Wen's equation, derivatives beside differences,
its energy.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.settings import Device, ObserverSettings, Sensed
from estimator.simulation import simulate
from tests.estimator.driven_axis import state_of
from tests.estimator.flow_pieces import slid

RATE, K, D = 500.0, (2.0 * np.pi * 20.0) ** 2, 3.0
KH, REACH, AMPLITUDE = 0.03 * K, 2.5e-4, 1e-3
DEVICE = Device(
    sample_rate=RATE,
    stiffness=(K,),
    damping=(D,),
    amplitude=AMPLITUDE,
    sense_gain=(1e3,),
    noise=(1e-3,),
)
ON = {"hysteretic_stiffness": {}}


def bouc_wen(v: float, z: float) -> float:
    """Wen 1976, equation 3, with A = 1, n = 1, β = γ = 1/(2 reach)."""
    return v - (abs(v) * z + v * abs(z)) / (2.0 * REACH)


def integrated(start, samples, push=lambda t: 0.0):
    """x and z at the samples, cut nowhere: steps far below a turn."""
    t = np.arange(samples) / RATE

    def slope(at, s):
        x, v, z = s
        return [v, push(at) - K * x - D * v - KH * z, bouc_wen(v, z)]

    return solve_ivp(slope, (0.0, t[-1]), (*start, 0.0), "RK45", t, rtol=1e-9, atol=1e-13, max_step=2e-5).y


def run(device=DEVICE, samples=400, drive=None, sensitive=False, **values):
    observer = Observer(device, ObserverSettings(effects=ON))
    state = state_of(observer, **({"khx": KH, "reach": REACH, "x": 1.1e-3} | values))
    return simulate(observer, state, np.zeros((samples, 1)) if drive is None else drive, sensitive=sensitive)


@pytest.mark.slow
def test_a_decay_runs_as_an_independent_integrator_says():
    expected = integrated((1.1e-3, 0.0), 400)
    assert np.max(np.abs(expected[2])) > 0.9 * REACH
    np.testing.assert_allclose(run().sensed[:, 0], 1e3 * expected[0], atol=2e-6)


@pytest.mark.long
def test_a_driven_mass_runs_so_too_and_so_does_its_velocity():
    held = 5.0 * np.random.default_rng(2).standard_normal((200, 1))
    expected = integrated((1.1e-3, 0.0), 200, lambda t: held[min(math.ceil(t * RATE - 1e-9), 199), 0])
    np.testing.assert_allclose(run(drive=held).sensed[:, 0], 1e3 * expected[0], atol=1e-5)
    moving = Device(**(vars(DEVICE) | {"sensed": (Sensed.VELOCITY,), "sense_gain": (1e3 * math.sqrt(K),)}))
    np.testing.assert_allclose(run(moving, drive=held).sensed[:, 0], 1e3 * expected[1], atol=2e-3)


@pytest.mark.moderate
@pytest.mark.parametrize("sensed", [Sensed.DISPLACEMENT, Sensed.VELOCITY])
def test_its_derivatives_are_those_of_differences(sensed):
    device = Device(**(vars(DEVICE) | {"sensed": (sensed,)}))
    observer = Observer(device, ObserverSettings(effects=ON))
    assert observer.names == ("x", "vx", "phi_x", "kxx", "dxx", "drive_gain_x", "khx", "reach")
    drive = 5.0 * np.random.default_rng(2).standard_normal((150, 1))
    found = run(device, 150, drive, sensitive=True).sensitivity[:, 0]
    at = {"x": 1.1e-3, "vx": 0.0, "phi_x": 0.0, "kxx": K, "dxx": D, "drive_gain_x": 1.0, "khx": KH, "reach": REACH}
    for i, (name, value) in enumerate(at.items()):
        nudge = 1e-4 * max(abs(value), abs(observer.factors[i]) * 0.1)
        ahead, behind = (run(device, 150, drive, **{name: value + side * nudge}).sensed[:, 0] for side in (1.0, -1.0))
        difference = (ahead - behind) / (2.0 * nudge)
        assert np.max(np.abs(found[:, i] - difference)) < 2e-3 * np.max(np.abs(difference)), name


def test_it_takes_energy_and_never_gives_any():
    """Over each closed cycle; a spring of the wrong sign would drive the mass."""
    swing = run(samples=2000, dxx=0.0).sensed[:, 0]
    peaks = np.abs(swing[1:-1])[(np.abs(swing[1:-1]) >= np.abs(swing[:-2])) & (np.abs(swing[1:-1]) > np.abs(swing[2:]))]
    assert np.max(peaks[-10:]) < 0.7 * np.max(peaks[:10])
    assert np.max(np.abs(run(samples=2000, dxx=0.0, khx=-KH).sensed)) > 1.5 * np.max(np.abs(swing))


@pytest.mark.parametrize("z", [-2e-4, -5e-5, 0.0, 1e-4, 2.4e-4])
@pytest.mark.parametrize("way", [1e-9, 1e-4, 7e-4])
def test_a_way_slides_it_as_its_equation_says_and_back(z, way):
    expected = solve_ivp(lambda _, s: [bouc_wen(1.0, s[0])], (0.0, way), (z,), rtol=1e-10, atol=1e-16, max_step=2e-6)
    there, by_z, by_way, by_reach = slid(z, way, REACH)
    assert there == pytest.approx(expected.y[0, -1], abs=1e-10)
    assert slid(there, -way, REACH)[0] == pytest.approx(z, abs=1e-15 / max(by_z, 1e-3))
    step = 1e-10
    for derivative, ahead, behind in (
        (by_z, slid(z + step, way, REACH)[0], slid(z - step, way, REACH)[0]),
        (by_way, slid(z, way + step, REACH)[0], slid(z, way - step, REACH)[0]),
        (by_reach, slid(z, way, REACH + step)[0], slid(z, way, REACH - step)[0]),
    ):
        assert derivative == pytest.approx((ahead - behind) / (2.0 * step), abs=1e-4)


def test_what_it_is_not_known_of_is_refused():
    with pytest.raises(ModelError, match="hysteretic_stiffness is known of a displacement or a velocity only"):
        Observer(Device(**(vars(DEVICE) | {"sensed": (Sensed.ACCELERATION,)})), ObserverSettings(effects=ON))
    many = {f"hysteretic_stiffness:{number}": {} for number in range(5)}
    with pytest.raises(ModelError, match="more than 4 springs that slip"):
        Observer(DEVICE, ObserverSettings(effects=many))


@pytest.mark.parametrize(
    ("z", "way", "after"),
    [(-0.3, -0.5, -0.8), (0.0, -0.5, -0.5), (-0.8, 0.5, -0.3), (-0.5, 0.5, 0.0)],
)
def test_against_the_motion_a_slip_moves_as_the_mass_does(z: float, way: float, after: float) -> None:
    assert slid(z, way, 1.0) == pytest.approx((after, 1.0, 1.0, 0.0))


@pytest.mark.parametrize(("z", "way"), [(0.2, 0.4), (0.6, -0.1), (-0.2, 0.7)])
def test_along_the_motion_a_slip_is_that_of_its_equation(z: float, way: float) -> None:
    """dz/dway = 1 − z/reach where z is along the motion, 1 where it is against it."""
    whole = solve_ivp(lambda _, at: 1.0 - np.maximum(at, 0.0) / 0.9, (0.0, way), [z], rtol=1e-10, atol=1e-12)
    assert slid(z, way, 0.9)[0] == pytest.approx(whole.y[0, -1], rel=1e-6)
