"""`hil identify` of the C board over a CAN interface, the bus watched by can-utils' candump and read from the DBC."""

import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from typing import Any, NamedTuple

import pytest

from estimator.identify import derived, fit  # noqa: F401 - loaded, so that a fork has it
from hil.cli import execute
from hil.cli import identify as _verb  # noqa: F401
from hil.identifying import identify as identifying
from hil.identifying import page
from hil.running.process import supervision  # noqa: F401 - loaded, so that its process is a fork
from hil.testing.board_rules.served import Board
from hil.wire.messages import SafeReason, State
from tests.cli.test_processes import children_of
from tests.firmware.test_identify import SHARE, SHORT
from tests.firmware.test_run import SLOW
from tests.vcan.test_run import PATIENCE_S, heard, serving, watching

pytestmark = [
    pytest.mark.slow,
    pytest.mark.usefixtures("no_report", "short"),
    pytest.mark.skipif(shutil.which("candump") is None, reason="candump is missing: sudo apt install can-utils"),
]

LIMIT = int(SHARE * 2**15)
LIMITS = ("--drive-limit", str(SHARE * 10.0), "--sense-limit", "0.1")
DRIVEN = b" 100##"  # DRIVE_FORCE, as candump writes it


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shorter experiment, in this process, without a page."""
    monkeypatch.setattr(identifying, "LENGTHS", SHORT)
    monkeypatch.setattr(page, "write_page", lambda *_: None)


def board(c_board: Path) -> Board:
    """One that stands still, at 3 kHz."""
    return Board([str(c_board), "--link", "can:vcan0", "--rate", "0", "--sample-rate", "3000"])


class Bus(NamedTuple):
    """largest: drive code on it; driven: drives of the host that were not zero; stops: why the board was SAFE by its
    own word, for each ARM; left_armed: whether it was in the end.
    """

    largest: int
    driven: int
    stops: list[int]
    left_armed: bool


def bus_of(log: Path) -> Bus:
    """What candump heard."""
    largest = driven = 0
    stops: list[int] = []
    armed = False
    for name, signals, _ in heard(log):
        if name == "DRIVE_FORCE":
            code = max(abs(signals["ux"]), abs(signals["uy"]))
            assert armed or not code
            largest, driven = max(largest, code), driven + (code > 0)
        elif name == "SENSE":
            largest = max(largest, abs(signals["ux_0"]), abs(signals["uy_0"]))
        elif name == "ARM":
            armed = True
        elif name == "STATUS" and armed and signals["state"] == State.SAFE:
            armed = False
            stops.append(signals["reason"])
    return Bus(largest, driven, stops, armed)


def test_it_is_found_within_its_limits_and_left_safe(
    c_board: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "bus.log"
    with serving(board(c_board)) as url, watching(log):
        capsys.readouterr()
        words = ["identify", url, "--arm", "--json", "-o", str(tmp_path / "my.bench.toml"), "--runs", str(tmp_path)]
        code = execute([*words, *LIMITS])
        said = capsys.readouterr()
    assert code == 0, said.err
    found = json.loads(said.out)
    assert found["latency_ticks"] == {"measured": 1, "identity": 1}
    truth = {name: SLOW[name] for name in ("kxx", "kyy", "kxy", "dxx", "dyy", "dxy")} | {"gain_x": 1e3, "gain_y": 1e3}
    for name, value in truth.items():
        one = found["constants"][name]
        assert abs(one["value"] - value) < 4.0 * one["u"], name
    bus = bus_of(log)
    assert 0 < bus.largest <= LIMIT
    assert bus.driven > 1000
    assert (bus.stops, bus.left_armed) == ([SafeReason.HOST_REQUEST] * 2, False)


WAYS_OUT: dict[str, tuple[int, str, list[int]]] = {
    "interrupted": (130, "SAFE was confirmed", [SafeReason.INTERRUPTED]),
    "command killed": (-signal.SIGKILL, "", [SafeReason.INTERRUPTED]),
    "loop killed": (2, "the loop's process was killed by SIGKILL; the record so far", [SafeReason.LINK_LOST]),
    "board killed": (2, "said nothing for 30 s", []),
}
"""Exit code, words, and why the board is SAFE by its own word."""


@pytest.mark.parametrize("ended", WAYS_OUT)
def test_every_other_way_out_ends_in_safe(c_board: Path, tmp_path: Path, ended: str) -> None:
    log, served = tmp_path / "bus.log", board(c_board)
    words = [sys.executable, "-m", "hil", "identify", served.url, "--arm", "-o", str(tmp_path / "my.bench.toml")]
    pipes: dict[str, Any] = {"stdin": DEVNULL, "stdout": PIPE, "stderr": PIPE, "text": True}
    with serving(served), watching(log), Popen([*words, "--runs", str(tmp_path), *LIMITS], **pipes) as host:
        try:
            wait_until_driven(log, host)
            end_it(ended, host, served)
            out, err = host.communicate(timeout=PATIENCE_S)  # the loop, too, has let go of standard error
        finally:
            host.kill()
    code, said, stops = WAYS_OUT[ended]
    assert (host.returncode, out) == (code, ""), err
    assert said in err
    assert "Traceback" not in err
    assert not (tmp_path / "my.bench.toml").exists()
    bus = bus_of(log)
    assert 0 < bus.largest <= LIMIT
    assert (bus.stops, bus.left_armed) == (stops, ended == "board killed")


def wait_until_driven(log: Path, host: "Popen[str]") -> None:
    """Until the bus has seen two thousand drives."""
    end = time.monotonic() + PATIENCE_S
    while log.read_bytes().count(DRIVEN) < 2000:
        assert time.monotonic() < end, "no drive"
        assert host.poll() is None, host.communicate()
        time.sleep(0.2)


def end_it(ended: str, host: "Popen[str]", served: Board) -> None:
    """The way out of this name."""
    assert served.process is not None
    if ended == "interrupted":
        host.send_signal(signal.SIGINT)
    elif ended == "command killed":
        host.kill()
    elif ended == "loop killed":
        os.kill(max(children_of(host.pid)), signal.SIGKILL)
    else:
        served.process.kill()
