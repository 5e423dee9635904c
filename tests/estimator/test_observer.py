"""What the loop around the observer relies on: blocks, decimation, gaps, the queue of commands."""

import copy
from dataclasses import fields, replace

import numpy as np
import pytest

from estimator.observer import Observer
from estimator.settings import Gain, ObserverSettings, Spread
from tests.estimator.gyro_loop import Record, Truth, close_loop, observer_of

TRUTH = Truth()
SETTINGS = ObserverSettings(spread=Spread(offset=0.01))


@pytest.fixture(scope="module")
def record() -> Record:
    return close_loop(observer_of(TRUTH, SETTINGS), TRUTH, 3000, 1.5)


@pytest.mark.moderate
def test_a_replay_says_what_the_loop_said(record: Record) -> None:
    """The loop's record estimated again in one block: the same states, innovations and angles."""
    observer = observer_of(TRUTH, SETTINGS)
    found = observer.run(record.sense, record.drive)
    np.testing.assert_allclose(found.state, record.x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        found.innovation / found.innovation_deviation, np.sign(TRUTH.sense_gain) * record.ratio, atol=1e-7
    )
    for name in ("angle", "angle_pattern", "angle_plain", "angle_rate_integral"):
        np.testing.assert_allclose(getattr(found, name), getattr(record, name), atol=1e-9)


@pytest.mark.moderate
def test_innovation_has_the_sign_of_the_volts(record: Record) -> None:
    """Sense minus prediction, in volts, although the sense gain is negative."""
    observer = observer_of(TRUTH, SETTINGS)
    observer.run(record.sense[:2000], record.drive[:2000])
    shifted = record.sense[2000:2001] + 0.05
    calm, moved = (
        copy.deepcopy(observer).run(sense, record.drive[2000:2001]).innovation
        for sense in (record.sense[2000:2001], shifted)
    )
    np.testing.assert_allclose(moved - calm, 0.05, rtol=1e-9)


def test_blocks_and_decimation_change_no_estimate(record: Record) -> None:
    device = TRUTH.device(stiffness=1.03)
    whole = Observer(device, SETTINGS).run(record.sense, record.drive)
    observer = Observer(device, SETTINGS)
    parts = [observer.run(record.sense[i : i + 700], record.drive[i : i + 700], every=10) for i in range(0, 2800, 700)]
    state = np.concatenate([part.state for part in parts])
    np.testing.assert_array_equal(state, whole.state[9:2800:10])
    np.testing.assert_array_equal(parts[0].index, np.arange(9, 700, 10))
    np.testing.assert_array_equal(np.concatenate([part.angle for part in parts]), whole.angle[:2800])
    np.testing.assert_array_equal(whole.of("rate"), whole.state[:, 6])


@pytest.mark.parametrize("every", [1, 7, 40, 5000, 10_000])
@pytest.mark.parametrize("gain", [Gain.EKF, Gain.FADING])
def test_the_portions_in_which_a_record_is_run_change_nothing(record: Record, every: int, gain, monkeypatch) -> None:
    said = []
    for portion in (1_000_000, 96):
        monkeypatch.setattr("estimator.observer._PORTION", portion)
        observer = observer_of(Truth(), settings=ObserverSettings(gain=gain))
        ran = observer.run(record.sense, record.drive, every=min(every, len(record.sense)))
        said.append((ran, observer.state, observer.covariance))
    (one, *last), (other, *other_last) = said
    for field in fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), field.name)
    for mine, its in zip(last, other_last, strict=True):
        assert np.array_equal(mine, its)


def test_single_axis_has_no_angle() -> None:
    device = replace(
        TRUTH.device(), stiffness=(1.6e6,), damping=(1.0,), sense_gain=(-890.0,), noise=(1e-4,), target_stiffness=None
    )
    found = Observer(device, ObserverSettings(gain=Gain.EKF)).run(np.zeros((5, 1)), np.zeros((5, 1)))
    for field in fields(found):
        if field.name.startswith("angle") or field.name.endswith("ratio"):
            assert not np.any(getattr(found, field.name))


@pytest.mark.moderate
def test_queue_tells_what_the_board_will_have_applied() -> None:
    truth = replace(TRUTH, latency=3)
    observer = observer_of(truth, SETTINGS, dither=0.3)
    sent = [observer.tick(100.0 * i, -50.0 * i, 0.0, 0.0) for i in range(8)]
    assert len(set(sent)) > 4
    # Computed from sample m it acts from m + 3 on and is echoed with sample m + 4: next comes what sample 4 commanded.
    assert observer.expected_drive() == pytest.approx(sent[4])
    observer.withdraw()
    for _ in range(3):
        observer.tick(np.nan, np.nan, *observer.expected_drive())
    assert observer.expected_drive() == pytest.approx(sent[6])


def test_a_long_gap_keeps_the_constants_and_finds_the_motion_anew(record: Record) -> None:
    observer = observer_of(TRUTH, SETTINGS)
    observer.run(record.sense, record.drive)
    before, deviation = observer.state[4:].copy(), np.sqrt(np.diag(observer.covariance))
    observer.lose_phase(500)
    after = np.sqrt(np.diag(observer.covariance))
    np.testing.assert_allclose(observer.state[4:], before)
    np.testing.assert_allclose(after[4:], deviation[4:])
    np.testing.assert_allclose(after[:4], TRUTH.amplitude * np.array([1.0, TRUTH.omega0] * 2))
    assert np.linalg.eigvalsh(observer.arrays.p)[0] > 0.0
    again = observer.run(record.sense[:300], np.zeros((300, 2)))  # the first 400 samples were without control
    error = again.state[-1, :4] - record.motion[299]
    assert np.max(np.abs(error) / again.deviation[-1, :4]) < 5.0


@pytest.mark.moderate
def test_codes_are_volts_of_their_own_channel(record: Record) -> None:
    """Two channels of unlike gain: the codes of a tick tell what their volts do in a block."""
    device = TRUTH.device(sense_gain=(TRUTH.sense_gain, 0.6 * TRUTH.sense_gain))
    ticked, run = (Observer(device, SETTINGS, TRUTH.controller()) for _ in range(2))
    sense, drive = record.sense[:50], record.drive[:50]
    for volts, force in zip(sense / TRUTH.sense_quantum, drive / TRUTH.force_quantum, strict=True):
        ticked.tick(*volts, *force)
    found = run.run(sense, drive)
    np.testing.assert_allclose(ticked.state, found.state[-1], rtol=1e-9)


@pytest.mark.moderate
@pytest.mark.parametrize("latency", [0, 1, 3])
def test_a_line_is_compensated_in_the_middle_of_its_interval(latency: int) -> None:
    omega, (cx, sx, cy, sy) = 900.0, (0.4, -0.2, -0.3, 0.25)
    asked = []
    for effects in ({}, {"base_vibration": {"omega": omega, "bcx": cx, "bsx": sx, "bcy": cy, "bsy": sy}}):
        observer = Observer(TRUTH.device(), replace(SETTINGS, effects=effects), TRUTH.controller(latency=latency))
        asked.append(np.array(observer.tick(100.0, 50.0, 0.0, 0.0)) * TRUTH.force_quantum)
    phase = omega * (1.0 + latency + 0.5) / TRUTH.sample_rate  # the first sample is one interval on
    line = np.array([cx, cy]) * np.cos(phase) + np.array([sx, sy]) * np.sin(phase)
    np.testing.assert_allclose(asked[1] - asked[0], -line, atol=6e-3)  # half an interval more or less is 0.03
