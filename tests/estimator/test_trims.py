"""Trim electrodes as known inputs of the observer, beside a plant that SciPy integrates with the true voltage."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.settings import ObserverSettings, ProcessNoise, Spread, Variant
from estimator.trims import Electrode
from tests.estimator.driven_axis import DEVICE as SINGLE
from tests.estimator.gyro_loop import Truth

TRUTH = Truth(offset=(0.0, 0.0), damping=(0.0, 0.0, 0.0))
OMEGA2 = TRUTH.omega0**2
SOFTENING = np.array([0.005, 0.001, -0.002]) * OMEGA2  # per V²
SETTLING, STEP, VOLTS, ROWS = 0.02, 1000, 2.0, 3000
ELECTRODE = Electrode(tuple(SOFTENING), (0.0, 0.0, 0.0), SETTLING)
KNOWN = ObserverSettings(
    spread=Spread(position=0.1, velocity=0.1, offset=1e-6, rate=1e-4, stiffness=1e-5, damping=1e-5),
    process_noise=ProcessNoise(),
    memory=1.0,
)


@pytest.fixture(scope="module")
def sense():
    """Volts of a free mass whose electrode is put to 2 V at sample 1000."""
    kxx, kyy, kxy = np.array(TRUTH.stiffness) * OMEGA2
    h = 1.0 / TRUTH.sample_rate

    def flow(t, s):
        since = t - STEP * h
        volts = VOLTS * -math.expm1(-since / SETTLING) if since > 0.0 else 0.0
        cxx, cyy, cxy = SOFTENING * volts**2
        x, vx, y, vy = s
        return [vx, -(kxx - cxx) * x - (kxy - cxy) * y, vy, -(kxy - cxy) * x - (kyy - cyy) * y]

    x, _, y, _ = TRUTH.start
    t = np.arange(ROWS) * h
    begin = [x * TRUTH.amplitude, 0.0, y * TRUTH.amplitude, 0.0]
    found = solve_ivp(flow, (0.0, t[-1]), begin, "DOP853", t, rtol=1e-10, atol=1e-15, max_step=h).y[[0, 2]].T
    return TRUTH.sense_gain * found + np.random.default_rng(1).normal(0.0, TRUTH.noise, found.shape)


def observer(electrodes=(ELECTRODE,), settings=KNOWN):
    made = Observer(TRUTH.device(stiffness=1.0, damping=1.0), settings)
    made.declare_trims(electrodes)
    return made


def run(made, sense, *, late=0, told=True):
    """Innovation over its deviation after the voltage was put, of an observer that is told `late` samples later."""
    drive = np.zeros_like(sense)
    made.run(sense[: STEP + late + 1], drive[: STEP + late + 1])
    if told:
        made.trims.put(0, VOLTS, late / TRUTH.sample_rate)
    found = made.run(sense[STEP + late + 1 :], drive[STEP + late + 1 :])
    return found, float(np.sqrt(np.mean((found.innovation / found.innovation_deviation)[200:] ** 2)))


def test_the_stiffness_follows_the_voltage_that_acted(sense):
    made = observer()
    found, ratio = run(made, sense)
    assert ratio == pytest.approx(1.0, abs=0.05)
    expected = (np.array(TRUTH.stiffness) * OMEGA2 - SOFTENING * VOLTS**2) / OMEGA2
    for name, value in zip(("kxx", "kyy", "kxy"), expected, strict=True):
        assert found.of(name)[-1] / OMEGA2 == pytest.approx(value, abs=1e-5)
    np.testing.assert_allclose(made.trims.softened, SOFTENING * VOLTS**2, rtol=1e-9)


def test_an_observer_that_is_told_late_catches_up(sense):
    """Its voltage is what one told in time has; the stiffness follows within the next sample."""
    _, ratio = run(observer(), sense, late=3)
    assert ratio == pytest.approx(1.0, abs=0.06)
    in_time, late = observer(), observer()
    run(in_time, sense)
    run(late, sense, late=3)
    np.testing.assert_allclose(late.trims.volts, in_time.trims.volts, rtol=1e-9)


@pytest.mark.parametrize("wrong", ["untold", "sign", "settling"])
def test_a_wrong_voltage_shows_in_the_innovation(sense, wrong):
    """What the test above would not see, were it blind."""
    electrode = {"untold": ELECTRODE, "sign": ELECTRODE._replace(softening=tuple(-SOFTENING)),
                 "settling": ELECTRODE._replace(settling=0.5)}[wrong]  # fmt: skip
    _, ratio = run(observer((electrode,)), sense, told=wrong != "untold")
    assert ratio > 1.5


def test_an_uncertain_coefficient_makes_the_stiffness_less_certain():
    """By hand: u(c) V² beside what the filter knew; and back to 0 V no less."""
    u = 1e-3 * OMEGA2
    made = observer((ELECTRODE._replace(softening_u=(u, 0.0, 0.5 * u), settling=0.0),))
    blind = np.full((1, 2), math.nan)
    before = made.covariance
    made.trims.put(0, VOLTS)
    made.run(blind, np.zeros((1, 2)))
    after = made.covariance
    for name, size in (("kxx", u), ("kyy", 0.0), ("kxy", 0.5 * u)):
        at = made.estimated.index(name)
        assert math.sqrt(after[at, at] - before[at, at]) == pytest.approx(size * VOLTS**2, rel=1e-3, abs=1e-2 * u)
    assert made.trims.softened_u[0] == pytest.approx(u * VOLTS**2)


def test_an_observer_that_does_not_estimate_the_stiffness_is_told_it(sense):
    sense_only = ObserverSettings(variant=Variant.SENSE, spread=KNOWN.spread)
    made = observer(settings=sense_only)
    found, ratio = run(made, sense)
    assert ratio == pytest.approx(1.0, abs=0.05)
    assert found.of("kxx")[-1] == pytest.approx(TRUTH.stiffness[0] * OMEGA2 - SOFTENING[0] * VOLTS**2, rel=1e-9)


def test_electrodes_that_cannot_be_are_refused():
    with pytest.raises(ModelError, match="8 are supported"):
        observer((ELECTRODE,) * 9)
    with pytest.raises(ModelError, match="two axes"):
        Observer(SINGLE, ObserverSettings()).declare_trims((ELECTRODE,))
