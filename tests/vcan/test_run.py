"""`hil run` over a CAN interface, the bus watched by can-utils' candump and read with cantools from the DBC."""

import contextlib
import json
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import can
import cantools.database
import numpy as np
import pytest

from hil.cli import execute
from hil.records.capture import read_capture
from hil.records.runfolder import RunFolder
from hil.running.process import supervision  # noqa: F401 - loaded, so that its process is a fork
from hil.testing.board_rules.served import Board
from hil.wire.spec import SPEC
from tests.forked import Forked

# An interface, which `make quick` does not set up; and a page takes long in the machine that has one.
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_report")]

TREE = Path(__file__).parents[2]
EXAMPLES = TREE / "examples"
PATIENCE_S = 120.0
SAMPLES = 3000
COLUMNS = ("vx", "vy", "ux", "uy")
LAST_ID = 0x7FF  # no message of the wire
LAST = b" 7FF#\n"  # the same, as candump writes it
BUFFER_BYTES = 4096  # of candump's standard output, where it is a file


@contextlib.contextmanager
def watching(log: Path) -> Iterator[None]:
    """candump, writing everything on the interface into its log format.

    It may be behind the bus when the test has ended, and what it has not read by then it drops at SIGINT.  So it is
    waited for until it has written frames that were sent last; there are enough of them to fill its buffer.
    """
    with log.open("w", encoding="ascii") as out:
        process = subprocess.Popen(["candump", "-L", "-r", "8388608", "vcan0"], stdout=out)
        try:
            yield
            with can.Bus("vcan0", interface="socketcan") as bus:
                for _ in range(BUFFER_BYTES // len(LAST) + 1):
                    bus.send(can.Message(arbitration_id=LAST_ID, is_extended_id=False))
            end = time.monotonic() + PATIENCE_S
            while LAST not in log.read_bytes():
                assert time.monotonic() < end, "candump is behind the bus"
                time.sleep(0.1)
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)


@contextlib.contextmanager
def serving(board: Board) -> Iterator[str]:
    """The link of a board, which ends as it is told to."""
    assert board.process is not None
    try:
        yield board.url
    finally:
        board.process.send_signal(signal.SIGTERM)
        board.process.communicate(timeout=PATIENCE_S)


def run(example: str, url: str, place: Path, said: pytest.CaptureFixture[str], *more: str) -> dict[str, object]:
    """`hil run` of an example in lockstep, short, that ends well; the object it prints.

    In this process, which has loaded what it needs: in the machine inside a new one takes half a minute for that.
    """
    bench = place / "short.bench.toml"
    text = (EXAMPLES / f"{example}.bench.toml").read_text(encoding="utf-8")
    bench.write_text(re.sub(r"^settle_s = .*$", "settle_s = 0.5", text, flags=re.MULTILINE), encoding="utf-8")
    arguments = [str(bench), "--link", url, "--arm", "--clock", "lockstep", "--duration", str(SAMPLES / 4000)]
    said.readouterr()
    code = execute(["run", *arguments, "--out", str(place), "--json", *more])
    told = said.readouterr()
    assert code == 0, told.err
    result: dict[str, object] = json.loads(told.out)
    return result


def heard(log: Path) -> Iterator[tuple[str, dict[str, int], can.Message]]:
    """What candump heard, as the DBC reads it."""
    database = cantools.database.load_file(TREE / "firmware" / "gyrohil.dbc")
    with can.CanutilsLogReader(log) as frames:
        for frame in frames:
            if frame.arbitration_id == LAST_ID:
                return
            message = database.get_message_by_frame_id(frame.arbitration_id)
            yield message.name, message.decode(bytes(frame.data), decode_choices=False, allow_truncated=True), frame


@pytest.mark.skipif(shutil.which("candump") is None, reason="candump is missing: sudo apt install can-utils")
def test_a_run_and_an_independent_witness(tmp_path, capsys):
    log = tmp_path / "bus.log"
    emulate = [sys.executable, "-m", "device_emulator", str(EXAMPLES / "s-slow.scenario.toml"), "--link", "can:vcan0"]
    with serving(Board(emulate, start=Forked)) as url, watching(log):
        assert url == "can:vcan0"
        result = run("s-slow", url, tmp_path, capsys)
    assert (result["verdict"], result["lost"], result["late"], result["samples"]) == ("good", 0, 0, SAMPLES)
    capture = read_capture(tmp_path / str(result["run"]) / "capture.arrow")
    rows, drives, said = [], [], []
    for name, signals, frame in heard(log):
        said.append(name)
        assert frame.is_fd == (name not in SPEC.can.classic), name
        if name == "SENSE":
            assert (signals["n"], frame.bitrate_switch, frame.dlc) == (1, True, 16)
            rows.append((signals["tick"], *(signals[f"{column}_0"] for column in COLUMNS)))
        elif name == "DRIVE_FORCE":
            drives.append((signals["seq"], signals["ux"], signals["uy"], signals["effective_tick"]))
    recorded = np.column_stack([capture.tick, *(capture.columns[f"{column}_code"] for column in COLUMNS)])
    assert np.array_equal(np.array(rows)[: len(recorded)], recorded)
    assert len(recorded) <= len(rows) <= len(recorded) + 1
    assert np.all(np.diff([seq for seq, *_ in drives]) % 2**16 == 1)
    assert said[0] == "HELLO"
    assert said.count("ARM") == 1
    assert said.index("SAFE") > said.index("DRIVE_FORCE")
    assert said.count("STATUS") == said.count("STATUS_BRIEF") >= 3


def test_a_run_of_the_c_board(c_board, tmp_path, capsys):
    with serving(Board([str(c_board), "--link", "can:vcan0?node=2", "--rate", "1.0"])) as url:
        assert url == "can:vcan0?node=2"
        result = run("c-board", url, tmp_path, capsys, "--wire-log", str(tmp_path / "bus.blf"))
    assert (result["verdict"], result["lost"], result["late"], result["samples"]) == ("good", 0, 0, SAMPLES)
    assert not any("wire log" in remark for remark in result["remarks"])
    with can.LogReader(tmp_path / "bus.blf") as log:
        heard = Counter(frame.arbitration_id for frame in log)
    identifiers = {name: SPEC.can.identifier(layout.type, 2, 1) for name, layout in SPEC.messages.items()}
    assert SAMPLES <= heard[identifiers["SENSE"]] <= SAMPLES + 1
    assert heard[identifiers["DRIVE_FORCE"] - 1] == SAMPLES + 1  # and one of zero after SAFE, which is refused


def test_a_run_in_board_mode_by_generated_code(c_board, tmp_path, capsys):
    with serving(Board([str(c_board), "--link", "can:vcan0?node=3", "--rate", "1.0", "--estimator"])) as url:
        result = run("c-board-own", url, tmp_path, capsys)
    assert (result["verdict"], result["mode"], result["lost"], result["samples"]) == ("good", "board", 0, SAMPLES)
    folder = RunFolder(tmp_path / str(result["run"]))
    own = folder.board_estimates
    assert len(own.tick) >= SAMPLES // 40 - 1  # the last one comes behind the last sample, with which the run ends
    assert np.array_equal(own.tick, 39 + 40 * np.arange(len(own.tick)))
    assert own["driving"][-1]
    assert abs(own["rate_rad_s"][-1] - 1.0) < 5.0 * own["sd_rate_rad_s"][-1]
    assert abs(own["kxx_per_s2"][-1] - 1.602e6) < 5.0 * own["sd_kxx_per_s2"][-1]
