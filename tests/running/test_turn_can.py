"""CAN in the turn in C: frames are read and made as Python does it; a run over a socket gives the same records."""

import json
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

import hil
from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.scenario import load
from hil.running.loop import turn
from hil.running.native import Kind
from hil.wire.can_format import FDF, HEAD, RECORD_SIZE, CanFormat
from hil.wire.can_link import CLASSIC_SIZE, CanLink
from hil.wire.errors import LinkClosed
from hil.wire.frame_format import BOARD, HOST
from hil.wire.inproc import InprocLink
from hil.wire.link import Claim
from hil.wire.messages import ClockMode
from tests.running import gyro
from tests.running.closed import close_loop
from tests.running.test_turn import RECORDS
from tests.running.turning import (
    NODE,
    both_on_can,
    can_counts,
    compare_can,
    in_python,
    recorded_as_python_reads,
    sent_as_python_does,
)

GOLDEN = Path(hil.__file__).parent.parent / "tests" / "wire" / "golden.json"
VECTORS = json.loads(GOLDEN.read_text(encoding="utf-8"))["frames"]
MODES: list[dict[str, Any]] = [{}, {"mode": "gain", "block": 20, "estimate_every": 20}]
BUS_OFF, NOT_ACKNOWLEDGED, TROUBLE = 0x40, 0x20, 0x20000000


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: vector["name"])
def test_golden_vectors_are_read_as_python_reads_them(vector: dict[str, Any]) -> None:
    c, python = both_on_can(0)
    for frame in vector["can"]:
        body, identifier = bytes.fromhex(frame["data"]), int(frame["id"], 16) | BOARD
        data = (HEAD.pack(identifier, len(body), FDF if frame["fd"] else 0) + body).ljust(RECORD_SIZE, b"\0")
        assert c.feed(data) == in_python(python, data)
    assert can_counts(c) == can_counts(python)


@pytest.mark.parametrize("seed", range(4))
def test_of_spoilt_frames_it_makes_what_python_makes(seed: int) -> None:
    assert min(compare_can(4000, seed)[:8]) > 0  # each kind of fault was there


class Overheard(InprocLink):
    """A board on CAN, in this process."""

    def __init__(self, scenario: Path) -> None:
        what = load(scenario)
        super().__init__(Board(what, Device(what), (ClockMode.LOCKSTEP,), CanFormat(NODE, BOARD)))
        self.format = CanFormat(NODE, HOST)
        self.sent: list[bytes] = []
        self.heard: list[bytes] = []

    def send(self, data: bytes) -> None:
        self.sent.append(data)
        super().send(data)

    def receive(self, timeout_s: float | None) -> bytes:
        self.heard.append(super().receive(timeout_s))
        return self.heard[-1]


@contextmanager
def bus(scenario: Path, until: int = 1 << 31) -> Iterator[CanLink]:
    """A socket of frames with the board behind it, which is off the bus after so many frames."""
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    board = Overheard(scenario)

    def serve() -> None:
        heard = 0
        with far, closing(board), suppress(ConnectionResetError, BrokenPipeError):
            while frame := far.recv(RECORD_SIZE):
                board.send(frame.ljust(RECORD_SIZE, b"\0"))
                heard += 1
                answer = board.receive(0.0)
                for at in range(0, len(answer), RECORD_SIZE):
                    record = answer[at : at + RECORD_SIZE]
                    far.send(record if record[5] & FDF else record[:CLASSIC_SIZE])
                if heard in (100, until):
                    word = BUS_OFF if heard == until else NOT_ACKNOWLEDGED
                    far.send(struct.pack("=IB11x", TROUBLE | word, 8))

    serving = threading.Thread(target=serve)
    serving.start()
    with closing(CanLink(near, "can:can9", NODE, HOST, Claim(f"test/{id(near)}", "can9", ""))) as link:
        yield link
    serving.join()


@pytest.mark.parametrize("loop", MODES, ids=["force", "gain"])
def test_a_run_over_a_bus_is_the_same_whoever_reads_its_frames(tmp_path: Path, loop: dict[str, Any]) -> None:
    """By a descriptor, and by bytes that Python gives to C, beside Python's own codec."""
    scenario, bench = gyro.scenario(tmp_path / "board.toml"), gyro.bench(0.5, loop=loop)
    link = Overheard(scenario)
    assert turn.kind_of(link) is Kind.BYTES
    run, _ = close_loop(link, bench, tmp_path / "bytes")
    assert sent_as_python_does(link.sent, CanFormat(NODE, HOST), CanFormat(NODE, BOARD)) > 2000 // loop.get("block", 1)
    recorded_as_python_reads(run, link.heard, CanFormat(NODE, HOST))
    with bus(scenario) as wired:
        assert turn.kind_of(wired) is Kind.CAN
        close_loop(wired, bench, tmp_path / "can")
        assert wired.advice.startswith("no node acknowledges")
    for stem in RECORDS:
        assert (tmp_path / "bytes" / f"{stem}.arrow").read_bytes() == (tmp_path / "can" / f"{stem}.arrow").read_bytes()


def test_a_controller_that_is_off_the_bus_ends_the_run(tmp_path: Path) -> None:
    with (
        bus(gyro.scenario(tmp_path / "board.toml"), until=300) as link,
        pytest.raises(LinkClosed, match=r"can:can9: the controller is off the bus; check wiring"),
    ):
        close_loop(link, gyro.bench(1.0), tmp_path / "run")
