"""Real time: a board that goes on by itself, and a host that is stopped, killed, interrupted, or loses it.

The board is slow enough (400 ticks a second) that only what a test does disturbs it.  What it did is read from
its truth file: the force is what is left of its motion after the free oscillation.
"""

import os
import signal
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from hil.boards.emulation import emulator
from hil.records.capture import RowFlag
from hil.records.truth import Truth, read_truth
from hil.wire.messages import SafeReason
from tests.running import gyro
from tests.running.closed import angle_errors
from tests.running.gyro import WATCHDOG_TICKS
from tests.running.processes import Host, alive, children, safe_reason, stopped, until

pytestmark = pytest.mark.slow

Ticks = NDArray[np.int64]

LATENCY = 1
DRIVEN = 640  # samples after which the loop has been closed for a while
FORCE_MPS2 = 1e-5  # what the truth shows of force where there is none: errors of its integration
ANGLE_RAD = 0.02  # of error after everything that is done to the loop here; a tick of error is 0.3 rad


def driven(truth: Truth, rate_rad_s: float = 0.1) -> Ticks:
    """Ticks at which an interval begins over which a force acted."""
    kxx, kyy, kxy = truth.header["stiffness_per_s2"]
    dxx, dyy, dxy = truth.header["damping_per_s"]
    square, double = rate_rad_s**2, 2 * rate_rad_s
    free = [
        [0, 1, 0, 0],
        [square - kxx, -dxx, -kxy, double - dxy],
        [0, 0, 0, 1],
        [-kxy, -double - dxy, square - kyy, -dyy],
    ]
    step_s = 1.0 / truth.header["sample_rate_Hz"]
    state = np.column_stack([truth[name] for name in ("x_m", "vx_mps", "y_m", "vy_mps")])
    kick = state[1:] - state[:-1] @ expm(np.array(free) * step_s).T
    return np.asarray(truth.tick[:-1][(np.abs(kick[:, [1, 3]]) > FORCE_MPS2 * step_s).any(axis=1)])


@pytest.mark.beyond(1)
@pytest.mark.realtime
@pytest.mark.parametrize("victim", ["loop", "host"])
def test_killed(tmp_path: Path, victim: str) -> None:
    """kill -9: the board lets go within its watchdog, the record is whole up to there, and life goes on."""
    truth = tmp_path / "truth.arrow"
    scenario = gyro.unhurried_scenario(tmp_path / "board.toml")
    with emulator(scenario, truth=truth) as board:
        with Host(tmp_path / "first", gyro.unhurried_bench(60.0), board.url) as host:
            host.await_record(DRIVEN)
            processes = [host.worker, *children(host.worker)]
            os.kill(host.worker if victim == "loop" else host.process.pid, signal.SIGKILL)
            code, said = host.ends()
            until(lambda: not any(map(alive, processes)))  # loop and recorder; the record is as it will be
            assert not any("Traceback" in line for line in said)
            first = host.capture
            assert not first.complete
            if victim == "loop":
                assert (code, host.result["verdict"]) == (1, "interrupted"), said
                assert host.result["reasons"] == ["the loop's process was killed by SIGKILL"]
                assert host.result["samples"] == len(first)
                assert not host.result["complete"]
                assert safe_reason(board.url) == SafeReason.LINK_LOST
            else:
                assert code == -signal.SIGKILL
                assert safe_reason(board.url) == SafeReason.INTERRUPTED
        with Host(tmp_path / "second", gyro.unhurried_bench(1.5), board.url) as host:
            code, said = host.ends()
            assert code in (0, 1), said
            second = host.capture
            assert second.complete
    force = driven(read_truth(truth))
    released = force[force < second.tick[0]][-1]
    assert first.tick[0] < released <= first.tick[-1] + LATENCY + WATCHDOG_TICKS
    assert first.tick[-1] < second.tick[0] <= force[-1]  # the board goes on counting, and is driven again


@pytest.mark.long
@pytest.mark.realtime
def test_stopped_for_less_than_the_watchdog(tmp_path: Path) -> None:
    """The board holds its drive; the answers that come too late are counted, and the loop goes on."""
    truth = tmp_path / "truth.arrow"
    scenario = gyro.unhurried_scenario(tmp_path / "board.toml")
    declared = gyro.unhurried_bench(6.0, link={"watchdog_s": 2.0})
    with emulator(scenario, truth=truth) as board, Host(tmp_path / "host", declared, board.url) as host:
        host.await_record(DRIVEN)
        with stopped(host.worker, 0.5):
            pass
        code, said = host.ends()
        assert code in (0, 1), said
        counters = host.result["counters"]
        assert (counters["rearmed"], counters["board_watchdog_trips"]) == (0, 0)
        assert counters["lost"] == 0
        answers = host.result["answers"]
        assert answers["unanswered"] > 150
        assert counters["held"] <= answers["late"] + answers["unanswered"] + answers["lost_to_board"]
        folder = host.folder
    assert np.abs(angle_errors(folder, truth, 4.0)).max() < ANGLE_RAD


@pytest.mark.realtime
def test_stopped_for_longer_than_the_watchdog(tmp_path: Path) -> None:
    """The board goes SAFE, the host finds out, arms it again and counts that, and the loop goes on."""
    truth = tmp_path / "truth.arrow"
    scenario = gyro.unhurried_scenario(tmp_path / "board.toml")
    with (
        emulator(scenario, truth=truth) as board,
        Host(tmp_path / "host", gyro.unhurried_bench(8.0), board.url) as host,
    ):
        host.await_record(DRIVEN)
        with stopped(host.worker, 2.0):
            pass
        code, said = host.ends()
        assert code in (0, 1), said
        counters, record, folder = host.result["counters"], host.capture, host.folder
        assert host.result["complete"]
    assert counters["rearmed"] == counters["board_watchdog_trips"] == 1
    assert counters["lost"] == host_lost(record.tick) > 300
    gap = int(np.argmax(np.diff(record.tick)))
    assert record.flags[gap + 1] & RowFlag.GAP_BEFORE
    force = driven(read_truth(truth))
    released = force[force < record.tick[gap + 1]][-1]
    answered = folder.timing
    assert answered is not None
    last_answer = answered.tick[answered.tick <= record.tick[gap] - WATCHDOG_TICKS][-1]
    assert released <= last_answer + LATENCY + WATCHDOG_TICKS
    assert force[-1] > record.tick[gap + 1]
    assert np.abs(angle_errors(folder, truth, 6.0)).max() < ANGLE_RAD


def host_lost(tick: Ticks) -> int:
    """Ticks missing from a record."""
    return int(tick[-1] - tick[0]) + 1 - len(tick)


@pytest.mark.long
def test_ctrl_c(tmp_path: Path) -> None:
    """SAFE is sent, the record closed with its end marker, and the exit code says what happened."""
    scenario = gyro.unhurried_scenario(tmp_path / "board.toml")
    with (
        emulator(scenario) as board,
        Host(tmp_path / "host", gyro.unhurried_bench(60.0), board.url, report=True) as host,
    ):
        host.await_record()
        host.interrupt()
        code, said = host.ends()
        assert code == 130, said
        assert host.capture.complete
        assert (host.result["verdict"], host.result["reasons"]) == ("interrupted", ["stopped on request"])
        assert host.folder.report_path.exists()
        assert safe_reason(board.url) == SafeReason.INTERRUPTED


@pytest.mark.parametrize("stage", ["connect", "prepare"])
@pytest.mark.beyond(1)
def test_ctrl_c_before_anything_is_recorded(tmp_path: Path, stage: str) -> None:
    scenario = gyro.unhurried_scenario(tmp_path / "board.toml")
    with Host(tmp_path / "host", gyro.unhurried_bench(60.0), f"pty:{scenario}") as host:
        host.await_stage(stage)
        others = children(host.process.pid)
        host.interrupt()
        code, said = host.ends()
        assert code == 130, said
        assert host.folders() == []
        assert not any(map(alive, others))


@pytest.mark.parametrize("clock", ["paced", "lockstep"])
@pytest.mark.beyond(1)
def test_a_board_that_dies(tmp_path: Path, clock: str) -> None:
    scenario = gyro.unhurried_scenario(tmp_path / "board.toml")
    declared = gyro.unhurried_bench(60.0 if clock == "paced" else 3000.0, clock)
    with Host(tmp_path / "host", declared, f"pty:{scenario}", report=True) as host:
        host.await_record()
        os.kill(host.child("device_emulator"), signal.SIGKILL)
        code, said = host.ends()
        assert code == 1, said
        assert not any("Traceback" in line for line in said)
        result = host.result
        assert (result["verdict"], len(result["reasons"])) == ("interrupted", 1)
        (reason,) = result["reasons"]
        assert "\n" not in reason
        assert "hung up" in reason or "died" in reason  # whichever is noticed first
        assert result["complete"]
        assert host.folder.report_path.exists()
