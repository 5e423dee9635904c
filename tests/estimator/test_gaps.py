"""The drive over gaps, estimated from the rows around: its error beside its stated one, by SciPy and an observer."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.gaps import Drives, Gaps, observe
from estimator.observer import Observer
from estimator.record import Record as Sensed
from estimator.settings import Gain, ObserverSettings
from tests.estimator.gyro_loop import Record, Truth, close_loop, observer_of

TRUTH = Truth(force_noise=1e-5)
SETTINGS = ObserverSettings(gain=Gain.EKF)
DITHER = 0.3
SAMPLES = 12_000
LENGTHS = (1, 2, 7, 25)


@pytest.fixture(scope="module")
def record() -> Record:
    return close_loop(observer_of(TRUTH, SETTINGS, dither=DITHER), TRUTH, SAMPLES, 1.0)


def drives_of(record: Record, known: np.ndarray) -> Drives:
    """What the rows that are known tell of the drive."""
    return Drives(
        np.where(known[:, None], record.sense, np.nan), record.drive, known,
        omega=TRUTH.omega0, step=1.0 / TRUTH.sample_rate, gain=1.0,
    )  # fmt: skip


def holed(record: Record, known: np.ndarray) -> tuple[np.ndarray, np.ndarray, Gaps]:
    """Sense with gaps, the drive estimated in them, and the gaps."""
    drives, sense = drives_of(record, known), np.where(known[:, None], record.sense, np.nan)
    drive, gap = drives.fill(sense, np.where(known[:, None], record.drive, 99.0), known)
    last = np.flatnonzero(gap)
    return sense, drive, Gaps(last, drives.spread(gap[last]))


def lost(length: int, share: float, seed: int = 0) -> np.ndarray:
    """Which of the samples are known, where so many are lost in runs of a length."""
    known = np.ones(SAMPLES, bool)
    for begin in np.random.default_rng(seed).integers(1000, SAMPLES - 100, round(share * SAMPLES / length)):
        known[begin : begin + length] = False
    return known


def moved(error: np.ndarray) -> np.ndarray:
    """x, ẋ, y, ẏ at the end of a gap by forces (length, 2) that nobody knows, integrated step by step."""
    h, s = 1.0 / TRUTH.sample_rate, np.zeros(4)
    for ux, uy in error:

        def flow(_: float, s: np.ndarray, ux: float = ux, uy: float = uy) -> list[float]:
            return [s[1], ux - TRUTH.omega0**2 * s[0], s[3], uy - TRUTH.omega0**2 * s[2]]

        s = solve_ivp(flow, (0.0, h), s, rtol=1e-9, atol=1e-18).y[:, -1]
    return s


@pytest.mark.slow
@pytest.mark.parametrize("length", LENGTHS)
def test_the_spread_is_that_of_the_errors(record: Record, length: int) -> None:
    """Of drives that were not learnt from, each direction of the motion by itself."""
    known = lost(length, 0.02 * min(length, 5))
    _, drive, gaps = holed(record, known)
    pushes, spreads = [], []
    for last, spread in zip(gaps.last, gaps.spread, strict=True):
        begin = last
        while not known[begin - 1]:
            begin -= 1
        if last + 1 - begin == length:
            pushes.append(moved((record.drive - drive)[begin : last + 1]))
            spreads.append(spread)
    assert len(pushes) > 35
    share = np.sqrt(np.mean(np.square(pushes), axis=0) / np.mean([np.diagonal(s) for s in spreads], axis=0))
    # A root mean square of so many has a standard deviation of 1/√2n, 12 % at most.
    np.testing.assert_allclose(share, 1.0, atol=4.0 / math.sqrt(2.0 * len(pushes)))


@pytest.mark.moderate
@pytest.mark.parametrize("length", LENGTHS)
def test_the_error_goes_with_nothing_that_is_known(record: Record, length: int) -> None:
    """A straight line between the rows around falls short of every crest: on average that is a weaker drive."""
    known = lost(length, 0.02 * min(length, 5), seed=1)
    _, drive, _ = holed(record, known)
    off = (record.drive - drive)[~known]
    slope = np.sum(off * drive[~known]) / np.sum(drive[~known] ** 2)
    deviation = math.sqrt(np.mean(off**2) / np.sum(drive[~known] ** 2))
    assert abs(slope) < 4.0 * math.sqrt(length) * deviation
    if length == 1:
        row = np.arange(SAMPLES)
        straight = np.column_stack([np.interp(row, row[known], channel[known]) for channel in record.drive.T])
        assert np.std((record.drive - straight)[~known]) > 1.05 * np.std(off)


@pytest.mark.moderate
@pytest.mark.parametrize(("length", "share"), [(1, 0.1), (7, 0.1), (25, 0.1)])
def test_innovations_are_as_large_as_predicted_behind_gaps(record: Record, length: int, share: float) -> None:
    sense, drive, gaps = holed(record, lost(length, share))
    assert len(gaps) > 30
    near = np.unique(np.clip(gaps.last[:, None] + np.arange(1, 21), 0, SAMPLES - 1))
    near = near[np.isfinite(sense[near, 0])]

    def ratio(gaps: Gaps | None) -> float:
        device = TRUTH.device(stiffness=1.03, damping=0.5)
        found = observe(Observer(device, SETTINGS, TRUTH.controller(dither=DITHER)), sense, drive, gaps)
        return float(np.mean((found.innovation / found.innovation_deviation)[near] ** 2))

    assert ratio(gaps) == pytest.approx(1.0, abs=6.0 * math.sqrt(2.0 / (2 * len(near))) + 0.02)
    if length > 1:
        assert ratio(None) > 1.5  # or nothing was learnt here


@pytest.mark.moderate
def test_a_gap_shows_in_the_parameters_deviation_only_so_far(record: Record) -> None:
    """With the gaps told, constants stay within their deviations; not told, they are off by many."""
    sense, drive, gaps = holed(record, lost(25, 0.1))

    def off(gaps: Gaps | None) -> float:
        observer = Observer(TRUTH.device(stiffness=1.03, damping=0.5), SETTINGS, TRUTH.controller(dither=DITHER))
        observe(observer, sense, drive, gaps, every=SAMPLES)
        names = ("kxx", "kyy", "kxy", "dxx", "dyy", "dxy")
        deviation = np.sqrt(np.diagonal(observer.covariance))
        errors = [
            (observer.state[observer.names.index(name)] - true) / deviation[observer.estimated.index(name)]
            for name, true in zip(names, TRUTH.parameters, strict=True)
        ]
        return float(np.max(np.abs(errors)))

    assert off(gaps) < 4.0
    assert off(None) > 8.0


def test_a_drive_that_was_off_was_off_and_one_that_was_switched_is_unknown(record: Record) -> None:
    known = np.ones(SAMPLES, bool)
    known[[100, 101, 5000]] = False  # the loop is closed at 400
    known[390:410] = False
    _, drive, gaps = holed(record, known)
    assert not drive[100:102].any()
    assert gaps.last.tolist() == [409, 5000]
    assert np.all(np.isinf(gaps.spread[0]))
    assert np.all(np.isfinite(gaps.spread[1]))


def test_of_an_unknown_drive_the_motion_is_found_anew(record: Record) -> None:
    observer = Observer(TRUTH.device(), SETTINGS, TRUTH.controller())
    observer.run(record.sense[:3000], record.drive[:3000])
    constants, before = observer.covariance[4:, 4:].copy(), observer.covariance[0, 0]
    observer.unsettle(np.full((4, 4), math.inf))
    np.testing.assert_array_equal(observer.covariance[4:, 4:], constants)
    assert observer.covariance[0, 0] == pytest.approx(TRUTH.amplitude**2)
    assert before < 1e-4 * TRUTH.amplitude**2


@pytest.mark.moderate
@pytest.mark.parametrize("every", [1, 7, SAMPLES, SAMPLES + 1])
def test_cut_at_gaps_that_add_nothing_a_record_is_what_it_was(record: Record, every: int) -> None:
    gaps = Gaps(np.array([0, 57, 58, SAMPLES - 1]), np.zeros((4, 4, 4)))
    cut, whole = (
        observe(Observer(TRUTH.device(), SETTINGS, TRUTH.controller()), record.sense, record.drive, given, every=every)
        for given in (gaps, None)
    )
    for name in ("index", "state", "deviation", "innovation", "innovation_deviation", "angle", "angle_deviation"):
        np.testing.assert_allclose(getattr(cut, name), getattr(whole, name), rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_the_oracle_is_unsettled_alike(record: Record) -> None:
    from estimator.oracle.numpy_observer import NumpyObserver

    rows = slice(0, 600)
    gaps = Gaps(np.array([450, 520]), np.array([1e-14 * np.diag([1.0, 1e6, 2.0, 2e6]), np.full((4, 4), math.inf)]))
    settings = replace(SETTINGS, gain=Gain.FADING, memory=0.25, reference=0.05)
    found, expected = (
        observe(kind(TRUTH.device(), settings, TRUTH.controller()), record.sense[rows], record.drive[rows], gaps)
        for kind in (Observer, NumpyObserver)
    )
    # Behind the second the oracle's angle has no deviation of its own (`tests/estimator/test_carried_angle.py`).
    for name, end in (("deviation", 600), ("innovation_deviation", 600), ("angle_deviation", 521)):
        np.testing.assert_allclose(getattr(found, name)[440:end], getattr(expected, name)[440:end], rtol=1e-4)


def test_a_record_is_cut_behind_gaps_whose_drive_nobody_knows() -> None:
    gaps = Gaps(np.array([139, 302]), np.full((2, 2, 2), np.inf))
    record = Sensed(np.zeros((400, 1)), np.zeros((400, 1, 1)), np.full(400, 1e-3), gaps=gaps)
    assert record.stretches == (slice(0, 140), slice(140, 303), slice(303, 400))
    known = replace(gaps, spread=np.zeros_like(gaps.spread))
    assert replace(record, gaps=known).stretches == (slice(0, 400),)
