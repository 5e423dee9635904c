"""What a board has to show before it goes on a rate table. Copy this folder, and add what your board promises."""

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.bench import Bench
from hil.records.capture import Capture
from hil.testing.board import BoardUnderTest
from hil.wire.errors import ProtocolError
from hil.wire.messages import DriveForce, SafeReason, State, Status
from hil.wire.sense import Sense


def test_it_says_who_it_is_and_that_is_what_the_bench_file_declares(board: BoardUnderTest, bench: Bench) -> None:
    identity = board.identity
    assert identity.axes == bench.device.axes
    assert identity.tick_rate_Hz == pytest.approx(bench.device.sample_rate_Hz, rel=1e-6)
    full_scale = identity.drive_scale_mps2 * 2 ** (identity.drive_bits - 1)
    assert full_scale == pytest.approx(bench.device.drive.full_scale, rel=0.01)
    assert identity.sense_scale_V < bench.device.sense.noise_V  # the noise covers the steps of the converter


def test_registers_keep_what_is_written_and_refuse_nonsense(board: BoardUnderTest) -> None:
    assert board.write("WATCHDOG_TICKS", 123) == 123
    assert board.read("WATCHDOG_TICKS") == 123
    with pytest.raises(ProtocolError, match="OUT_OF_RANGE"):
        board.write("WATCHDOG_TICKS", -1)
    assert board.read("WATCHDOG_TICKS") == 123


@pytest.mark.hil_clock("paced")
def test_a_silent_host_trips_the_watchdog(board: BoardUnderTest) -> None:
    """One drive, and then nothing: the force must be zero, and the board must say why."""
    board.use_clock("paced")
    ticks = round(0.05 * board.identity.tick_rate_Hz)
    board.write("WATCHDOG_TICKS", ticks)
    board.arm()
    (first, *_) = board.endpoint.receive_rows(1.0)
    board.endpoint.send(DriveForce(100, 0, first[0] + ticks // 2))
    told = [message for message in board.listen(0.5) if isinstance(message, Status)]
    assert (told[-1].state, told[-1].reason) == (State.SAFE, SafeReason.WATCHDOG)
    assert told[-1].watchdog_trips >= 1
    assert not [message for message in board.listen(0.1) if isinstance(message, Sense)]


def test_the_noise_is_what_the_data_sheet_says(board: BoardUnderTest, bench: Bench) -> None:
    """With the drive at zero, above the resonance; 20 % more than declared is too much."""
    capture = recorded(board.run(open_loop=True, duration_s=2.0).folder.capture)
    for axis in range(capture.axes):
        assert noise_above_V(capture.sense_V[:, axis], 3.0 * bench.device.resonance_Hz, capture.tick_rate_Hz) < (
            1.2 * bench.device.sense.noise_V
        )


def test_the_ring_down_has_the_declared_quality(board: BoardUnderTest, bench: Bench) -> None:
    """The energy of both axes together decays as exp(−ω t/Q), however it wanders between them."""
    capture = recorded(board.run(open_loop=True, duration_s=3.0).folder.capture)
    declared = 2.0 * np.pi * bench.device.resonance_Hz / np.mean(bench.device.damping_per_s[:2])
    assert quality(capture, bench.device.resonance_Hz) == pytest.approx(declared, rel=0.6)


def test_the_closed_loop_keeps_the_limits_of_the_bench_file(board: BoardUnderTest) -> None:
    run = board.run(duration_s=4.0, settle_s=2.0)
    assert run.result.verdict == "good", run.result.reasons
    assert run.result.lost == 0
    assert run.folder.capture is not None
    assert run.folder.capture.complete


@pytest.mark.hil_emulated
def test_the_angle_follows_the_rotation(board: BoardUnderTest) -> None:
    """Only an emulated board knows its true angle; beside a rate table, compare with the table's."""
    score = board.run(duration_s=6.0, settle_s=3.0, truth=True).result.score
    assert score is not None
    assert score.turns > 0.5
    assert score.angle_per_rotation == pytest.approx(1.0, abs=2e-3)


def recorded(capture: Capture | None) -> Capture:
    """The capture of a run, which must be there and whole."""
    assert capture is not None
    assert capture.complete
    return capture


def noise_above_V(signal: NDArray[np.float64], lowest_Hz: float, rate_Hz: float) -> float:
    """Standard deviation of white noise with the mean density of the signal above a frequency."""
    spectrum = np.abs(np.fft.rfft(signal * np.hanning(len(signal)))) ** 2
    density = spectrum[np.fft.rfftfreq(len(signal), 1.0 / rate_Hz) > lowest_Hz].mean()
    return float(np.sqrt(density / np.sum(np.hanning(len(signal)) ** 2)))


def quality(capture: Capture, resonance_Hz: float) -> float:
    """Q of a ring-down, from the slope of the logarithm of the energy over windows of ten cycles."""
    window = round(10.0 * capture.tick_rate_Hz / resonance_Hz)
    whole = len(capture) // window * window
    energy = capture.sense_V[:whole].reshape(-1, window, capture.axes).var(axis=1).sum(axis=1)
    time_s = (np.arange(len(energy)) + 0.5) * window / capture.tick_rate_Hz
    slope_per_s = np.polyfit(time_s, np.log(energy), 1)[0]
    return float(-2.0 * np.pi * resonance_Hz / slope_per_s)
