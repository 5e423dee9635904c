"""The angle's own error: its variance beside errors that really happen, the reversal of the virtual rotation, κ."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from estimator.observer import Observer
from estimator.settings import ObserverSettings, ProcessNoise
from tests.estimator.gyro_loop import Record, Truth, close_loop, observer_of

pytestmark = pytest.mark.slow

TRUTH = Truth(force_noise=1e-5)
REFERENCE_S, SAMPLES, RATE = 0.5, 6000, 2.0
SETTINGS = ObserverSettings(process_noise=ProcessNoise(force=1e-5), memory=0.25, reference=REFERENCE_S)


def replayed(record: Record, settings: ObserverSettings, **control: object) -> object:
    """The record through an observer like the one in the loop."""
    observer = Observer(TRUTH.device(stiffness=1.03, damping=0.5), settings, TRUTH.controller(**control))
    return observer.run(record.sense, record.drive)


SEEDS = 48
AGES = [2400, 4000, 5990]
KNOWN = replace(SETTINGS, spread=replace(SETTINGS.spread, stiffness=0.0, damping=1e-6))


@pytest.fixture(scope="module")
def noises() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Over seeds, root mean square of the angle's error since the reference instant at three ages, and the deviation
    said of it: of an observer that estimates the parameters, and of one that knows them.
    """
    errors: dict[str, list[np.ndarray]] = {"estimated": [], "known": []}
    said: dict[str, list[np.ndarray]] = {"estimated": [], "known": []}
    reference = round(REFERENCE_S * TRUTH.sample_rate) - 1
    for seed in range(SEEDS):
        record = close_loop(observer_of(TRUTH, SETTINGS, dither=0.3), TRUTH, SAMPLES, RATE, seed=seed)
        exactly = Observer(TRUTH.device(), KNOWN, TRUTH.controller(dither=0.3))
        runs = {
            "estimated": replayed(record, SETTINGS, dither=0.3),
            "known": exactly.run(record.sense, record.drive),
        }
        for name, run in runs.items():
            error = run.angle - record.turned
            errors[name].append(error[AGES] - error[reference])
            said[name].append(run.angle_deviation[AGES])
    return {
        name: (np.sqrt(np.mean(np.square(errors[name]), axis=0)), np.sqrt(np.mean(np.square(said[name]), axis=0)))
        for name in errors
    }


@pytest.mark.long
@pytest.mark.parametrize("name", ["estimated", "known"])
def test_deviation_is_that_of_the_errors_over_many_noises(
    noises: dict[str, tuple[np.ndarray, np.ndarray]], name: str
) -> None:
    """As near as chance lets the root mean square of so many come: a thousandth lies beyond, at each end."""
    found, said = noises[name]
    low, high = np.sqrt(chi2.ppf([1e-3 / len(AGES), 1.0 - 1e-3 / len(AGES)], SEEDS) / SEEDS)
    assert np.all(found > low * said), found / said
    assert np.all(found < high * said), found / said


def test_it_is_zero_at_the_reference_instant_and_grows_after_it() -> None:
    record = close_loop(observer_of(TRUTH, SETTINGS, dither=0.3), TRUTH, SAMPLES, RATE)
    deviation = replayed(record, SETTINGS, dither=0.3).angle_deviation
    near = round(REFERENCE_S * TRUTH.sample_rate) - 1
    reference = near + int(np.argmin(deviation[near : near + 2]))  # time is a sum, and rounded
    assert deviation[reference] == 0.0 < deviation[reference - 1]
    assert deviation[-1] > deviation[reference + 200] > 0.0


@pytest.mark.long
def test_unknown_parameters_leave_the_angle_less_certain(
    noises: dict[str, tuple[np.ndarray, np.ndarray]],
) -> None:
    """What is taken off for forces was computed with estimated constants: known ones leave less to err about, and how
    much less is what the errors say. The two have their noise in common: their ratio scatters less than one of two
    independent ones, which chance takes beyond the bounds once in a thousand, at each end.
    """
    (found, said), (found_known, said_known) = noises["estimated"], noises["known"]
    low, high = np.sqrt(f_distribution.ppf([1e-3, 1.0 - 1e-3], SEEDS, SEEDS))
    assert found_known[-1] < low * found[-1]  # beyond chance
    share = (said_known / said)[-1] / (found_known / found)[-1]
    assert low < share < high


@pytest.mark.parametrize("latency", [0, 1, 3])
def test_a_reversed_virtual_rotation_leaves_the_angle_right(latency: int) -> None:
    truth = replace(TRUTH, latency=latency)
    virtual, period = 5e-3 * truth.omega0, 0.4
    observer = observer_of(truth, SETTINGS, dither=0.3, virtual_reversal=period)
    record = close_loop(observer, truth, SAMPLES, RATE)
    settled = slice(2000, None)
    error = (record.angle - record.turned)[settled]
    assert np.max(np.abs(error - error[0])) < 1e-3
    # The same motion is another ellipse in the frame that turns the other way: no step of the angle.
    still = close_loop(observer_of(truth, SETTINGS, dither=0.3), truth, SAMPLES, RATE)
    usual = np.max(np.abs(np.diff((still.angle - still.turned)[settled])))
    assert np.max(np.abs(np.diff(error))) < 2.0 * usual
    # What forces turned the pattern by: a triangle of the height virtual × period, wherever it begins.
    forced = replayed(record, SETTINGS, dither=0.3, virtual_reversal=period).angle_forced[settled]
    assert np.ptp(forced) == pytest.approx(virtual * period, rel=0.1)
    # The pattern less ∫Ωv follows it through the reversals: a sign or a sample wrong would leave a triangle too.
    pattern = (record.angle_pattern - record.turned)[settled]
    assert np.ptp(pattern) < 0.05 * virtual * period


def test_an_angular_gain_leaves_the_virtual_rotation_alone() -> None:
    """The plant turns the pattern by one for one; told that it is 0.8, the observer reports the board's 1/0.8."""
    record = close_loop(observer_of(TRUTH, SETTINGS, dither=0.3), TRUTH, SAMPLES, RATE)
    one = replayed(record, SETTINGS, dither=0.3)
    device = TRUTH.device(stiffness=1.03, damping=0.5, angular_gain=0.8)
    # The random walk and the spread of the rate are stated of the board's: the same pattern wants them larger.
    settings = replace(SETTINGS, spread=replace(SETTINGS.spread, rate=SETTINGS.spread.rate / 0.8))
    other = Observer(device, settings, TRUTH.controller(dither=0.3)).run(record.sense, record.drive)
    for name in ("angle", "angle_deviation", "angle_forced", "angle_pattern", "angle_plain", "angle_rate_integral"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name) / 0.8, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(other.of("rate"), one.of("rate") / 0.8, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(other.innovation, one.innovation, rtol=1e-9, atol=1e-12)
