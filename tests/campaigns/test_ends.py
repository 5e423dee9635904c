"""Campaigns that are interrupted or killed, as processes: what is done stays, and the rest comes out the same."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import hil
from hil.sweeping.plan import toml_of
from tests.campaigns.conftest import bytes_in
from tests.campaigns.small import RUNS

pytestmark = pytest.mark.slow


def start(place: Path) -> "subprocess.Popen[str]":
    """`hil sweep` with two workers, in a folder, until it has done two runs more."""
    process = subprocess.Popen(
        [sys.executable, "-m", "hil", "sweep", "small.campaign.toml", "--workers", "2"],
        cwd=place, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    wall = place / "runs" / "small" / "wall.jsonl"
    until, there = time.monotonic() + 100.0, wall.read_text().count("\n") if wall.exists() else 0
    while not wall.exists() or wall.read_text().count("\n") < there + 2:
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.02)
    return process


def children_of(parent: int) -> list[int]:
    """Process numbers of the children of all threads of a process."""
    tasks = Path(f"/proc/{parent}/task").iterdir()
    return [int(word) for task in tasks for word in (task / "children").read_text().split()]


def alive(pid: int) -> bool:
    """Whether a process runs; one that only waits to be reaped does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.fixture
def place(tmp_path: Path) -> Path:
    (tmp_path / "small.campaign.toml").write_text(toml_of(RUNS, "A campaign."))
    return tmp_path


def interrupted(place: Path) -> int:
    """A campaign that Ctrl-C ended as it should; how many of its runs are done."""
    process = start(place)
    children = children_of(process.pid)
    assert len(children) >= 2
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30.0)
    assert process.returncode == 130
    assert out == ""
    assert "of 16 runs are done and kept in runs/small; `hil sweep small.campaign.toml` goes on" in err
    assert not any(alive(child) for child in children)
    done = (place / "runs/small/wall.jsonl").read_text().count("\n")
    assert 2 <= done < 16
    return done


def test_ctrl_c_ends_well_and_says_how_to_go_on(place: Path) -> None:
    assert interrupted(place)


@pytest.mark.long
def test_what_ctrl_c_ended_goes_on_and_nothing_is_lost(place: Path, whole: dict[str, bytes]) -> None:
    assert interrupted(place)
    assert hil.sweep(RUNS, out=place / "runs/small", workers=1).table["run"].to_pylist() == list(range(16))
    runs = [json.loads(line)["run"] for line in (place / "runs/small/wall.jsonl").read_text().splitlines()]
    assert sorted(runs) == list(range(16))  # none of those that were done was made again
    assert bytes_in(place / "runs/small") == whole


@pytest.mark.long
def test_killed_and_gone_on_with_by_processes_that_die_it_is_the_same(place: Path, whole: dict[str, bytes]) -> None:
    process = start(place)
    children = children_of(process.pid)
    process.kill()
    process.communicate()
    until = time.monotonic() + 10.0
    while any(alive(child) for child in children) and time.monotonic() < until:
        time.sleep(0.1)
    assert not any(alive(child) for child in children)
    process = start(place)  # goes on, and those that make its runs are killed
    for child in children_of(process.pid):
        os.kill(child, signal.SIGKILL)
    assert "are there already" in process.communicate(timeout=100.0)[1]
    assert process.returncode == 0
    assert bytes_in(place / "runs/small") == whole
