"""An element with play: the free run beside an integrator that stops at its events, derivatives beside differences, the
energy of a cycle in closed form, its memory.
"""

import math

import numpy as np
import pytest

from estimator.effects.catalogue import effect_for
from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.settings import Device, ObserverSettings, Sensed
from estimator.simulation import simulate
from tests.estimator.flow_pieces import caught
from tests.play import integrated, play

RATE, K, D = 500.0, (2.0 * np.pi * 20.0) ** 2, 3.0
KP, WIDTH, AMPLITUDE = 0.03 * K, 2.5e-4, 1e-3
DEVICE = Device(
    sample_rate=RATE,
    stiffness=(K,),
    damping=(D,),
    amplitude=AMPLITUDE,
    sense_gain=(1e3,),
    noise=(1e-3,),
)
ON = {"play": {}}


def run(device=DEVICE, samples=400, drive=None, sensitive=False, **values):
    observer = Observer(device, ObserverSettings(effects=ON))
    state = observer.state.copy()
    for name, value in ({"kpx": KP, "half_width": WIDTH, "x": 1.1e-3} | values).items():
        state[observer.names.index(name)] = value
    return simulate(observer, state, np.zeros((samples, 1)) if drive is None else drive, sensitive=sensitive)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kp", "width"), [(KP, WIDTH), (0.2 * K, 6e-4), (0.05 * K, 1e-5), (KP, 1.3e-3), (0.02 * K, 1.04e-3)]
)
def test_a_decay_runs_as_an_integrator_that_stops_at_its_events(kp, width):
    t = np.arange(300) / RATE
    expected = integrated(K, D, kp, width, 1.1e-3, t)
    found = run(samples=300, kpx=kp, half_width=width).sensed[:, 0]
    np.testing.assert_allclose(found, 1e3 * expected[0], atol=2e-7 * (kp / KP) ** 2 + 1e-9)
    # The reference is what the operator says of its own motion, on a grid.
    np.testing.assert_allclose(expected[2], play(expected[0], width), atol=3e-2 * AMPLITUDE)


@pytest.mark.moderate
def test_a_driven_mass_runs_so_too_and_so_does_its_velocity():
    held = 5.0 * np.random.default_rng(2).standard_normal((200, 1))
    t = np.arange(200) / RATE
    expected = integrated(K, D, KP, WIDTH, 1.1e-3, t, lambda at: held[min(math.ceil(at * RATE - 1e-9), 199), 0])
    np.testing.assert_allclose(run(drive=held).sensed[:, 0], 1e3 * expected[0], atol=2e-7)
    moving = Device(**(vars(DEVICE) | {"sensed": (Sensed.VELOCITY,), "sense_gain": (1e3 * math.sqrt(K),)}))
    np.testing.assert_allclose(run(moving, drive=held).sensed[:, 0], 1e3 * expected[1], atol=1e-4)


@pytest.mark.parametrize("sensed", [Sensed.DISPLACEMENT, Sensed.VELOCITY])
@pytest.mark.parametrize("width", [WIDTH, 9e-4])
def test_its_derivatives_are_those_of_differences(sensed, width):
    device = Device(**(vars(DEVICE) | {"sensed": (sensed,)}))
    observer = Observer(device, ObserverSettings(effects=ON))
    assert observer.names == ("x", "vx", "phi_x", "kxx", "dxx", "drive_gain_x", "kpx", "half_width")
    drive = 5.0 * np.random.default_rng(2).standard_normal((150, 1))
    at = {"x": 1.1e-3, "vx": 0.0, "phi_x": 0.0, "kxx": K, "dxx": D, "drive_gain_x": 1.0, "kpx": KP, "half_width": width}
    found = run(device, 150, drive, sensitive=True, **at).sensitivity[:, 0]
    for i, (name, value) in enumerate(at.items()):
        nudge = 1e-4 * max(abs(value), abs(observer.factors[i]) * 0.1)
        ahead, behind = (
            run(device, 150, drive, **(at | {name: value + side * nudge})).sensed[:, 0] for side in (1.0, -1.0)
        )
        difference = (ahead - behind) / (2.0 * nudge)
        assert np.max(np.abs(found[:, i] - difference)) < 2e-3 * np.max(np.abs(difference)), name


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7])
def test_a_cycle_loses_2_kp_w_times_the_amplitude_beyond_the_half_width(share):
    """½ k (A₁² − A₂²) = kp w (A₁ + A₂ − 2 w): at both turns the element is as far, the foot went the rest."""
    fine = Device(**(vars(DEVICE) | {"sample_rate": 20.0 * RATE}))
    width = share * AMPLITUDE
    swing = 1e-3 * run(fine, 1300, dxx=0.0, half_width=width, x=AMPLITUDE).sensed[:, 0]
    before, there, after = swing[:-2], swing[1:-1], swing[2:]
    tops = (np.abs(there) > np.abs(before)) & (np.abs(there) >= np.abs(after))
    turns = np.abs(there - (after - before) ** 2 / (8.0 * (after - 2.0 * there + before)))[tops]
    assert len(turns) == 5
    for first, second in zip([AMPLITUDE, *turns[:-1]], turns, strict=True):
        taken = 0.5 * K * (first**2 - second**2)
        assert taken == pytest.approx(KP * width * (first + second - 2.0 * width), rel=1e-4)


@pytest.mark.moderate
@pytest.mark.parametrize("share", [0.05, 0.4, 0.7])
def test_the_force_along_a_cycle_encloses_its_closed_form(share):
    """∮ kp (x − z) dx = 4 kp w (A − w) is taken; ∮ kp z dx is as much with the other sign."""
    x = AMPLITUDE * np.sin(np.linspace(0.0, 4.0 * np.pi, 40001))
    width = share * AMPLITUDE
    s, stops = 0.0, []
    for way in np.diff(x):
        sign = 1.0 if way > 0.0 else -1.0
        s = sign * caught(sign * s, abs(way), width)[0]
        stops.append(s)
    stops = np.array(stops)
    np.testing.assert_allclose(stops, x[1:] - play(x, width)[1:], atol=1e-12)
    last = slice(20000, 40000)
    area = np.sum(KP * 0.5 * (stops[last] + stops[19999:39999]) * np.diff(x)[last])
    assert area == pytest.approx(4.0 * KP * width * (AMPLITUDE - width), rel=1e-4)
    foot = x[1:] - stops
    assert np.sum(KP * 0.5 * (foot[last] + foot[19999:39999]) * np.diff(x)[last]) == pytest.approx(-area, rel=1e-4)


def test_below_the_half_width_it_is_a_spring_and_loses_nothing():
    within = run(dxx=0.0, x=0.9 * WIDTH).sensed
    np.testing.assert_allclose(within, run(dxx=0.0, x=0.9 * WIDTH, kxx=K + KP, kpx=0.0).sensed, atol=1e-9)
    assert np.max(np.abs(within[-30:])) > 0.98 * np.max(np.abs(within[:30]))


@pytest.mark.moderate
def test_it_remembers_where_it_was():
    """Pushed beyond the half-width once, the mass comes to rest beside where it was; a spring without memory would
    not.
    """
    drive = np.zeros((1000, 1))
    drive[10:30] = 0.8 * K * AMPLITUDE
    found = run(samples=1000, drive=drive, x=0.0, dxx=100.0).sensed[-1, 0]
    x = integrated(K, 100.0, KP, WIDTH, 0.0, np.arange(1000) / RATE, lambda t: drive[math.ceil(t * RATE - 1e-9), 0])
    assert abs(x[0, -1]) > 1e-3 * AMPLITUDE
    assert found == pytest.approx(1e3 * x[0, -1], abs=1e-7)


def test_it_takes_energy_and_of_the_other_sign_would_drive():
    swing = run(samples=1000, dxx=0.0).sensed[:, 0]
    assert np.max(np.abs(swing[-30:])) < 0.7 * np.max(np.abs(swing[:30]))
    assert np.max(np.abs(run(samples=1000, dxx=0.0, kpx=-KP).sensed)) > 1.2 * np.max(np.abs(swing))


@pytest.mark.parametrize("s", [-1.0, -0.4, 0.0, 0.9])
@pytest.mark.parametrize("way", [1e-3, 0.3, 2.5])
def test_a_way_and_its_derivatives(s, way):
    there, by_s, by_way, by_width = caught(s, way, 1.0)
    assert there == min(s + way, 1.0)
    step = 1e-7
    for derivative, ahead, behind in (
        (by_s, caught(s + step, way, 1.0), caught(s - step, way, 1.0) if s > -1.0 else None),
        (by_way, caught(s, way + step, 1.0), caught(s, way - step, 1.0)),
    ):
        if behind is not None:
            assert derivative == pytest.approx((ahead[0] - behind[0]) / (2.0 * step), abs=1e-6)
    assert by_width == (1.0 if s + way >= 1.0 else 0.0)


def test_its_axes_share_a_half_width_and_it_waits_to_be_asked():
    _, effect = effect_for("play", 2)
    assert [(c.name, c.unit) for c in effect.coefficients] == [("kpx", "1/s²"), ("kpy", "1/s²"), ("half_width", "m")]
    assert (effect.rare, effect.runs_freely) == (True, True)


def test_what_it_is_not_known_of_is_refused():
    with pytest.raises(ModelError, match="play is known of a displacement or a velocity only"):
        Observer(Device(**(vars(DEVICE) | {"sensed": (Sensed.ACCELERATION,)})), ObserverSettings(effects=ON))
