"""The angle over a stretch whose drive nobody knows: its error beside the deviation said of it, and beside no error."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from estimator.settings import Gain, ObserverSettings, ProcessNoise
from tests.estimator.gyro_loop import Record, Truth, close_loop, observer_of

pytestmark = pytest.mark.moderate

TRUTH = Truth(force_noise=1e-5)
WALK = 0.5  # of the rate, rad/s/√s
SETTINGS = ObserverSettings(gain=Gain.EKF, process_noise=ProcessNoise(force=1e-5, rate=WALK))
DITHER = 0.3
SAMPLES, FIRST, GAPS, ROOM = 20_000, 3000, 40, 400
ANYTHING = np.full((4, 4), math.inf)


@pytest.fixture(scope="module")
def record() -> Record:
    """A loop at a rate that is a random walk about 2 rad/s."""
    steps = np.random.default_rng(11).normal(0.0, WALK / math.sqrt(TRUTH.sample_rate), SAMPLES + 1)
    rate = 2.0 + np.cumsum(steps)
    return close_loop(observer_of(TRUTH, SETTINGS, dither=DITHER), TRUTH, SAMPLES, rate)


def through_a_gap(record: Record, begin: int, length: int) -> tuple[np.ndarray, np.ndarray]:
    """Error of the angle (n,) since the sample before a gap, from behind it on, and its deviation by the observer.

    Over the gap no sample is seen, and a drive is taken for the one that acted which has nothing to do with it.
    """
    reference = (begin - 0.5) / TRUTH.sample_rate
    observer = observer_of(TRUTH, replace(SETTINGS, reference=reference), dither=DITHER)
    before = observer.run(record.sense[:begin], record.drive[:begin])
    behind = slice(begin + length, begin + length + ROOM)
    observer.run(np.full((length, 2), math.nan), np.tile([3.0, -2.0], (length, 1)))
    observer.unsettle(ANYTHING)
    found = observer.run(record.sense[behind], record.drive[behind])
    error = found.angle - record.turned[behind] - (before.angle[-1] - record.turned[begin - 1])
    return error, found.angle_deviation


@pytest.mark.parametrize("length", [1, 60, 400])
def test_its_deviation_is_that_of_the_errors(record: Record, length: int) -> None:
    begins = np.linspace(FIRST, SAMPLES - length - ROOM, GAPS).astype(int)
    errors, said = zip(*(through_a_gap(record, int(begin), length) for begin in begins), strict=True)
    for at in (10, 60, ROOM - 1):  # while it is carried on, and when the pattern is followed again
        ratio = float(
            np.mean([(error[at] / deviation[at]) ** 2 for error, deviation in zip(errors, said, strict=True)])
        )
        low, high = chi2.ppf([1e-4, 1.0 - 1e-4], GAPS) / GAPS
        assert 0.5 * low < ratio < high, (at, ratio)
        assert np.max(np.abs([error[at] for error in errors])) < 0.05


def test_what_forces_did_meanwhile_is_taken_off(record: Record) -> None:
    """Angle and forced rotation of a row go by the pattern, as in all rows."""
    observer = observer_of(TRUTH, SETTINGS, dither=DITHER)
    observer.run(record.sense[:5000], record.drive[:5000])
    whole = copy.deepcopy(observer)
    observer.unsettle(ANYTHING)
    found, known = (one.run(record.sense[5000:5400], record.drive[5000:5400]) for one in (observer, whole))
    by_pattern = [run.angle + run.angle_forced for run in (found, known)]  # θ0 − θ
    np.testing.assert_allclose(by_pattern[0][100:], by_pattern[1][100:], atol=2e-3)
    np.testing.assert_allclose(
        found.angle_forced[-1] - found.angle_forced[300], known.angle_forced[-1] - known.angle_forced[300], atol=1e-4
    )


def test_sample_by_sample_it_is_what_it_is_in_blocks(record: Record) -> None:
    """But for when the pattern is followed again: at the sample, or at the end of its cycle."""
    codes = record.sense / TRUTH.sense_quantum, record.drive / TRUTH.force_quantum
    ticked, run = (observer_of(TRUTH, SETTINGS, dither=DITHER) for _ in range(2))
    for observer in (ticked, run):
        observer.run(record.sense[:5000], record.drive[:5000])
        observer.lose_motion()
    rows = slice(5000, 5200)
    angles = []
    for sense, drive in zip(codes[0][rows], codes[1][rows], strict=True):
        ticked.tick(*sense, *drive)
        angles.append(float(ticked.newest["angle"]))
    block = run.run(record.sense[rows], record.drive[rows])
    np.testing.assert_allclose(angles[:10], block.angle[:10], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(angles, block.angle, rtol=0.0, atol=2e-3)
    assert float(ticked.newest["angle_variance"]) == pytest.approx(block.angle_deviation[-1] ** 2, rel=0.3)


def test_one_observer_that_goes_on_from_another_carries_its_angle_on(record: Record) -> None:
    first, second = (observer_of(TRUTH, SETTINGS, dither=DITHER) for _ in range(2))
    first.run(record.sense[:5000], record.drive[:5000])
    first.lose_motion()
    second.adopt(first)
    found, adopted = (one.run(record.sense[5000:5200], record.drive[5000:5200]) for one in (first, second))
    np.testing.assert_array_equal(found.angle, adopted.angle)


def test_where_there_is_no_angle_yet_none_is_carried(record: Record) -> None:
    fresh, lost = (observer_of(TRUTH, SETTINGS, dither=DITHER) for _ in range(2))
    lost.lose_motion()
    found, expected = (one.run(record.sense[:600], record.drive[:600]) for one in (lost, fresh))
    np.testing.assert_allclose(found.angle, expected.angle)
