"""docs/safety.md, "The host", 7 and 8: a recorder or a loop that dies, stands still or finds no room, and Ctrl-C."""

import os
import re
import resource
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from hil.records.capture import read_capture
from hil.wire.messages import State
from tests.running import gyro
from tests.running.misbehaving import Board, served
from tests.running.processes import Host, alive, children, until

pytestmark = pytest.mark.slow

WATCHDOG_S = 20.0  # far longer than it takes: not the watchdog's doing


def bench(clock: str = "paced", mode: str = "force", **changes: object) -> object:
    loop = {"mode": "gain", "block": 20, "estimate_every": 20} if mode == "gain" else {}
    return gyro.unhurried_bench(600.0, clock, loop=loop, link={"watchdog_s": WATCHDOG_S, "timeout_s": 1.0})


def last_drive_s(board: Board) -> float:
    """How long ago the board was last driven."""
    return time.monotonic() - board.driven[-1][0] if board.driven else float("inf")


@pytest.mark.realtime
def test_a_recorder_that_is_killed_ends_the_run_within_a_second(tmp_path: Path) -> None:
    with served(Board()) as board, Host(tmp_path / "host", bench(), board.url) as host:
        host.await_record(600)
        (recorder,) = children(host.worker)
        os.kill(recorder, signal.SIGKILL)
        killed_s = time.monotonic()
        until(lambda: board.state is State.SAFE)
        assert board.safe_heard_s is not None
        assert board.safe_heard_s - killed_s < 1.0
        code, said = host.ends()
        assert code == 1, said
        result = host.result
        assert result["verdict"] == "interrupted"
        assert result["parts"]["safety"]["outcome"] == "failed"
        assert "the recorder was killed by SIGKILL" in result["reasons"][0]
        assert not any("Traceback" in line for line in said), said
        assert len(host.capture) > 0
        assert not host.capture.complete


@pytest.mark.realtime
def test_a_recorder_that_stands_still_ends_the_run(tmp_path: Path) -> None:
    """Nothing is lost by it: what waits in memory is written once it goes on."""
    with served(Board()) as board, Host(tmp_path / "host", bench(), board.url) as host:
        host.await_record(600)
        (recorder,) = children(host.worker)
        os.kill(recorder, signal.SIGSTOP)
        stopped_s = time.monotonic()
        until(lambda: board.state is State.SAFE)
        assert board.safe_heard_s is not None
        assert board.safe_heard_s - stopped_s < 4.0
        code, said = host.ends()
        assert code == 1, said
        assert "the recorder is stuck" in host.result["reasons"][0]
        assert host.result["parts"]["safety"]["outcome"] == "failed"
        assert host.capture.complete
        assert len(host.capture) == host.result["counters"]["samples"]


@pytest.mark.beyond(1)
@pytest.mark.parametrize("clock", ["paced", "lockstep"])
def test_a_disk_that_is_full_ends_the_run(tmp_path: Path, clock: str) -> None:
    with served(Board()) as board, Host(tmp_path / "host", bench(clock), board.url) as host:
        host.await_stage("run")
        until(lambda: host.folders() != [] and host.folder.capture_path.exists())
        (writer,) = [host.worker] if clock == "lockstep" else children(host.worker)
        size = host.folder.capture_path.stat().st_size + 20_000
        resource.prlimit(writer, resource.RLIMIT_FSIZE, (size, size))
        code, said = host.ends()
        assert code == 1, said
        assert not any("Traceback" in line for line in said), said
        assert "file too large" in host.result["reasons"][0]
        assert ".arrow" in host.result["reasons"][0]
        assert host.result["parts"]["safety"]["outcome"] == "failed"
        assert board.state is State.SAFE
        assert len(read_capture(host.folder.capture_path)) > 0


def test_when_the_loop_is_killed_the_host_confirms_safe_itself(tmp_path: Path) -> None:
    """A board whose watchdog is as long as this one's does not stop by itself soon."""
    with served(Board()) as board, Host(tmp_path / "host", bench(), board.url) as host:
        host.await_record(600)
        processes = [host.worker, *children(host.worker)]
        os.kill(processes[0], signal.SIGKILL)
        killed_s = time.monotonic()
        until(lambda: board.safes > 0)
        assert time.monotonic() - killed_s < 3.0
        code, said = host.ends()
        assert code == 1, said
        assert host.result["parts"]["safety"] == {"outcome": "good", "reason": "SAFE was confirmed", "next": None}
        assert host.result["reasons"] == ["the loop's process was killed by SIGKILL"]
        assert not any(map(alive, processes))


def test_ctrl_c_says_what_was_done(tmp_path: Path) -> None:
    with served(Board()) as board, Host(tmp_path / "host", bench(), board.url) as host:
        host.await_stage("prepare")
        host.interrupt()
        code, said = host.ends()
        assert (code, board.arms) == (130, 0)
        assert any(line.startswith("nothing was armed") for line in said), said
        assert host.folders() == []
    with served(Board()) as board, Host(tmp_path / "again", bench(), board.url) as host:
        host.await_record()
        host.interrupt()
        code, said = host.ends()
        assert code == 130
        (line,) = (line for line in said if "SAFE was confirmed at tick" in line)
        (there,) = re.findall(r"whole up to tick (\d+) of 240000: ", line)  # of 600 s at 400 Hz
        assert int(there) == 1 + np.ptp(host.capture.tick)


def test_ctrl_c_during_the_report_leaves_a_result(tmp_path: Path) -> None:
    declared = gyro.unhurried_bench(2.0, link={"watchdog_s": WATCHDOG_S, "timeout_s": 1.0})
    with served(Board()) as board, Host(tmp_path / "host", declared, board.url, report=True) as host:
        host.await_stage("report")
        host.interrupt()
        code, said = host.ends()
        assert code == 130, said
        assert any("SAFE was confirmed at tick" in line and "the record is whole" in line for line in said), said
        assert host.result["parts"]["safety"]["outcome"] == "good"
        assert host.capture.complete
