"""The turn in C: what it reads is what the Python receiver reads, what it sends is what Python sends, and nothing that
protects the board comes after an answer."""

import json
import math
import os
import shutil
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import hil
from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.scenario import load
from device_emulator.section import ScenarioError
from estimator.observer import Observer
from hil.records.runfolder import RunFolder
from hil.running import native
from hil.running.loop import turn
from hil.running.loop.skeleton import BeyondLimits
from hil.running.native import Kind
from hil.wire.errors import ProtocolError
from hil.wire.inproc import InprocLink
from hil.wire.messages import ClockMode, DriveForce
from hil.wire.serial_format import SERIAL
from hil.wire.stream import Receiver
from tests.running import gyro
from tests.running.closed import board, close_loop, waiting
from tests.running.turning import (
    CReceiver,
    compare,
    counts,
    in_python,
    recorded_as_python_reads,
    sent_as_python_does,
)

ROOT = Path(hil.__file__).parent.parent
FRAMES = json.loads((ROOT / "tests" / "wire" / "golden.json").read_text(encoding="utf-8"))["frames"]
RECORDS = ("capture", "innovation", "estimates", "covariance")


class Overheard(InprocLink):
    """Keeps what the host sends, and what it hears."""

    def __init__(self, device: Board) -> None:
        super().__init__(device)
        self.sent: list[bytes] = []
        self.heard: list[bytes] = []

    def send(self, data: bytes) -> None:
        self.sent.append(data)
        super().send(data)

    def receive(self, timeout_s: float | None) -> bytes:
        self.heard.append(super().receive(timeout_s))
        return self.heard[-1]

    @property
    def drives(self) -> list[DriveForce]:
        rx = Receiver()
        found = [item.message for data in self.sent for item in rx.feed(data)]
        return [message for message in found if isinstance(message, DriveForce)]


@pytest.mark.parametrize("vector", FRAMES, ids=lambda vector: vector["name"])
def test_golden_vectors_are_read_as_python_reads_them(vector: dict[str, Any]) -> None:
    data = bytes.fromhex(vector["frame"])
    c, python = CReceiver(), Receiver()
    found = c.feed(data)
    assert found == in_python(python, data)
    assert found != ([], [])
    assert c.counts() == counts(python)


@pytest.mark.moderate
@pytest.mark.parametrize("seed", range(4))
def test_of_spoilt_bytes_it_makes_what_python_makes(seed: int) -> None:
    assert compare(250_000, seed) > 1000


@pytest.mark.slow
def test_spoilt_bytes_reach_no_undefined_behaviour(tmp_path: Path) -> None:
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("no gcc with its sanitizers: sudo apt install gcc")
    for package in ("hil", "estimator", "device_emulator", "tests"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__", "libturn*"))
    folder = Path(native.__file__).parent
    checks = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all", "-g", "-O1"]
    sources = [
        folder / "turn.c",
        *(ROOT / "firmware" / "src" / f"hil_{name}.c" for name in ("spec", "frame", "crc32c")),
    ]
    library = tmp_path / "hil" / "running" / "native" / "libturn.so.1"
    subprocess.run([compiler, "-std=c99", *checks, "-fPIC", "-shared", "-o", library, *sources, "-lm"], check=True)
    asan = subprocess.run([compiler, "-print-file-name=libasan.so"], capture_output=True, text=True, check=True)
    environment = os.environ | {
        "LD_PRELOAD": asan.stdout.strip(),
        "ASAN_OPTIONS": "detect_leaks=0",  # Python's own
        "PYTHONPATH": str(tmp_path),
    }
    command = [sys.executable, "-m", "tests.running.turning", "300000"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=tmp_path)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.startswith("all")


@pytest.mark.moderate
@pytest.mark.parametrize("loop", [{}, {"mode": "gain", "block": 20, "estimate_every": 20}], ids=["force", "gain"])
def test_bytes_and_records_are_those_of_pythons_own_codec(tmp_path: Path, loop: dict[str, Any]) -> None:
    link = Overheard(board(gyro.scenario(tmp_path / "board.toml")))
    run, _ = close_loop(link, gyro.bench(0.5, loop=loop), tmp_path / "run")
    assert sent_as_python_does(link.sent, SERIAL, SERIAL) > 2000 // loop.get("block", 1)
    recorded_as_python_reads(run, link.heard, SERIAL)


def test_the_residual_is_judged_before_the_answer_leaves(tmp_path: Path) -> None:
    """The sample that stops the run is recorded, and not answered."""

    def spoil(observer: Observer) -> None:
        observer.x[:] = math.nan

    link = Overheard(board(gyro.scenario(tmp_path / "board.toml")))
    run, counters = close_loop(link, gyro.bench(1.0), tmp_path / "run", spoil)
    assert run.capture is not None
    assert run.timing is not None
    assert counters.residual_safe == 1
    assert len(run.timing) == len(run.capture) - 1 == counters.samples - 1
    # the last one offered after SAFE is the bench's question whether the board refuses it
    assert len([drive for drive in link.drives if drive.effective_tick <= counters.samples - 1]) == counters.samples - 1


@pytest.mark.parametrize("codes", [(math.nan, 0), (0, math.inf), (40_000, 0), (0, -1_000_000)])
def test_what_may_not_be_sent_is_not(tmp_path: Path, codes: tuple[float, float]) -> None:
    """Whatever gives the drive is not trusted: not a number, or beyond the limit, ends the run unsent."""

    def spoil(observer: Observer) -> None:
        honest = observer.tick

        def tick(*sample: float) -> Any:
            return codes if observer.newest["angle"] != 0.0 else honest(*sample)

        observer.tick = tick  # type: ignore[method-assign]

    link = Overheard(board(gyro.scenario(tmp_path / "board.toml")))
    with pytest.raises(BeyondLimits, match=r"the control law gave drive codes of .* nothing was sent"):
        close_loop(link, gyro.bench(0.2), tmp_path / "run", spoil)
    assert all((drive.ux, drive.uy) == (0, 0) for drive in link.drives)


def test_what_python_raises_within_a_turn_is_raised_behind_it(tmp_path: Path) -> None:
    class Broken(InprocLink):
        def send(self, data: bytes) -> None:
            super().send(data)
            if self._board.tick >= 30:  # type: ignore[union-attr]
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        close_loop(Broken(board(gyro.scenario(tmp_path / "board.toml"))), gyro.bench(0.2), tmp_path / "run")
    capture = RunFolder(tmp_path / "run").capture
    assert capture is not None
    assert len(capture) == 29  # rows 0 to 28: that of tick 29 was being answered


def test_a_full_ring_of_a_lockstep_run_is_waited_for(tmp_path: Path) -> None:
    """A ring smaller than what is written between two looks of the recorder."""
    from hil.running.recording.recorder import record_apart
    from hil.running.recording.tracks import run_layouts
    from tests.running import closed

    def apart(folder: Path, layouts: Any) -> Any:
        return record_apart(folder, layouts, wait=True, ring_rows=dict.fromkeys(layouts, 64))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(closed, "record_here", apart)
        run, counters = closed.close_loop(
            waiting(gyro.scenario(tmp_path / "board.toml")), gyro.bench(0.5), tmp_path / "run"
        )
    assert run_layouts is not None
    assert run.capture is not None
    assert run.innovation is not None
    assert (counters.samples, len(run.capture), len(run.innovation)) == (2000, 2000, 2000)


def test_links_that_somebody_wrapped_are_asked_through_python(tmp_path: Path) -> None:
    from hil.wire.pty_link import open_pty
    from hil.wire.serial_link import SerialLink, open_serial

    class Wrapped(SerialLink):
        def receive(self, timeout_s: float | None) -> bytes:
            return super().receive(timeout_s)

    with closing(open_pty()) as far, closing(open_serial(far.path)) as near:
        assert turn.kind_of(near) is Kind.STREAM
        near.send = near.send  # type: ignore[method-assign]
        assert turn.kind_of(near) is Kind.BYTES
        assert turn.kind_of(Wrapped(near._port, far.path)) is Kind.BYTES
    direct = waiting(gyro.scenario(tmp_path / "board.toml"))
    assert turn.kind_of(direct) is Kind.MEMORY
    direct.send = direct.send  # type: ignore[method-assign]
    assert turn.kind_of(direct) is Kind.BYTES
    assert turn.kind_of(Overheard(board(tmp_path / "board.toml"))) is Kind.BYTES
    assert turn.kind_of(InprocLink(OnlyPython())) is Kind.BYTES


class OnlyPython:
    """A board of somebody else's."""

    def exchange(self, data: bytes) -> bytes:
        return data

    def close(self) -> None:
        """Nothing to finish."""


FAULTS = {
    "sound": "",
    "tripped": "[[faults.tripped]]\nstart_s = 0.2\nduration_s = 0.02\n",
    "stuck": '[[faults.stuck]]\naxis = "y"\nstart_s = 0.1\nduration_s = 0.05\n',
}


@pytest.mark.moderate
@pytest.mark.parametrize("faults", FAULTS.values(), ids=FAULTS)
@pytest.mark.parametrize("changes", [{}, {"sense": {"adc_bits": 24}}], ids=["narrow", "wide"])
def test_a_board_in_this_process_answers_without_python_as_with_it(
    tmp_path: Path, changes: dict[str, Any], faults: str
) -> None:
    """The same records, counters and truth, and the same end, whichever way its bytes come."""
    what = gyro.scenario(tmp_path / "board.toml", **changes)
    with what.open("a") as file:
        file.write(faults)
    found = []
    for way, kind in ((InprocLink, Kind.MEMORY), (Overheard, Kind.BYTES)):
        folder, truth = tmp_path / kind.name, tmp_path / f"{kind.name}.arrow"
        link = way(board(what, truth=truth))
        assert turn.kind_of(link) is kind
        try:
            end: Any = close_loop(link, gyro.bench(0.5), folder)[1]
        except ProtocolError as error:
            end = str(error)
        found.append((end, *[(folder / f"{name}.arrow").read_bytes() for name in RECORDS], truth.read_bytes()))
    assert found[0] == found[1]
    assert ("FAULT" in str(found[0][0])) == ("tripped" in faults)
    capture = RunFolder(folder).capture
    assert capture is not None
    assert len(capture) == (802 if "tripped" in faults else 2000)  # the interval from tick 800 on ends in row 801


def test_what_a_board_raises_within_a_turn_is_raised_behind_it(tmp_path: Path) -> None:
    """Such as a truth file that finds no room: at the end of a page of rows, in the middle of a call of C."""

    def full(first: int, _: Any) -> None:
        if first == 64:
            raise ScenarioError("no room")

    what = load(gyro.scenario(tmp_path / "board.toml"))
    link = InprocLink(Board(what, Device(what, None, full), (ClockMode.LOCKSTEP,)))
    with pytest.raises(ScenarioError, match="no room"):
        close_loop(link, gyro.bench(0.2), tmp_path / "run")
    capture = RunFolder(tmp_path / "run").capture
    assert capture is not None
    assert len(capture) == 127  # the 128th was being answered


def test_a_signal_ends_a_wait_in_c_at_once(tmp_path: Path) -> None:
    """The handler of a signal is Python's, which does not run while C waits: a descriptor wakes it."""
    program = """
import os, signal, sys, threading, time
from tests.running import gyro
from hil.running.process import worker
from hil.running.native import Why
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.pty_link import open_pty
from hil.wire.serial_link import open_serial
from estimator.observer import Observer
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from tests.running.misbehaving import Board

class Silent(Board):
    def say_row(self, *row):
        return b""

with Silent() as board:
    bench = gyro.unhurried_bench(1.0, "paced", link={"timeout_s": 2.0, "watchdog_s": 0.5})
    endpoint = Endpoint(open_serial(board.url.removeprefix("serial:")))
    identity = client.connect(endpoint)
    observer = Observer(board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))
    class Nowhere:
        dropped = 0
        def push(self, rows): return len(rows)
        def put(self, *values): return True
    tracks = dict.fromkeys(("capture", "timing", "innovation", "estimates", "covariance"), Nowhere())
    loop = worker.make_loop(endpoint, identity, bench, observer, tracks, {"WATCHDOG_TICKS": 200.0})
    worker._on_signals(loop)
    threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGTERM)).start()
    loop._lend()
    begin = time.monotonic()
    why = loop._c.run()
    print(why is Why.WOKEN, loop.stop, time.monotonic() - begin < 0.24, loop._slice_s)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.stdout.strip() == "True True True 0.25", done.stderr[-2000:]
