"""A board on wall time that serves two hosts in turn and times their answers where a board feels them: at its end.

`python -m benchmarks.pacer ORDER`, ORDER being JSON: {"scenario", "seed", "truth", "segment_s"}.  Two ptys with a
board behind each: one for the real host, one for a process that does nothing but read and write.  By turns each gets a
segment of ticks at absolute deadlines, while time stands still for the other.  What is sent to them is made by the same
work and equally long, and their answers are stamped by the same lines.  Prints the paths of the two ptys, and, once the
real host has left, what came of both, as JSON lines.
"""

import json
import select
import sys
import time
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator import realtime
from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.scenario import Scenario, load
from device_emulator.truth_file import TruthFile, truth_metadata
from hil.running.realtime import end_with_parent
from hil.wire.errors import LinkClosed
from hil.wire.messages import Arm, ClockMode, DriveForce, Hello
from hil.wire.pty_link import open_pty
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter

ANSWER_LENGTH = len(Transmitter().encode(DriveForce(1, 1, 1), 1))
LEAD_S = 0.002  # from the choice of a host to its first tick


class Line(ABC):
    """A pty, the board behind it, and the stamps: when each sample was sent and when its answer had been read."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self.link = open_pty()
        self.samples = 0
        self.late = 0  # not answered when the next tick began
        self._newest: bytes | int = b""
        self._elapsed_ns: list[int] = []
        self._waiting: dict[bytes | int, int] = {}  # when the samples without an answer were sent, by their mark

    def tick(self) -> None:
        """Go on by one tick, and send what the board has to say of it."""
        said = self.board.block()
        self._newest = self.mark(said)
        self._waiting[self._newest] = time.monotonic_ns()
        self.samples += 1
        self.link.send(said)

    def end_of_tick(self) -> None:
        """What has not been answered by now is late; an answer that is still to come is stamped nevertheless."""
        self.late += self._newest in self._waiting

    def receive(self) -> None:
        """Stamp what has come, and only then look into it."""
        data = self.link.receive(0.0)
        now = time.monotonic_ns()
        for mark in self.marks(data):
            sent = self._waiting.pop(mark, None)
            if sent is not None:
                self._elapsed_ns.append(now - sent)
        self.attend(data)

    @abstractmethod
    def mark(self, said: bytes) -> bytes | int:
        """By what an answer tells which sample it belongs to."""

    @abstractmethod
    def marks(self, data: bytes) -> list[bytes | int]:
        """The marks of the answers in `data`."""

    @abstractmethod
    def attend(self, data: bytes) -> None:
        """What else there is to do about `data`."""

    def figures(self) -> dict[str, float]:
        """Counts, and percentiles of the time from sample to answer in µs."""
        p50, p99, p999 = (float(value) for value in np.percentile(self._elapsed_ns, (50.0, 99.0, 99.9)) / 1e3)
        return {"samples": self.samples, "late": self.late, "p50": p50, "p99": p99, "p999": p999}


class RealHost(Line):
    """A host that speaks the protocol: a drive tells by its effective tick which row it was computed from."""

    def __init__(self, board: Board, latency: int) -> None:
        super().__init__(board)
        self._latency = latency
        self._rx = Receiver()

    def mark(self, said: bytes) -> int:
        return self.board.tick

    def marks(self, data: bytes) -> list[bytes | int]:
        messages = [received.message for received in self._rx.feed(data)]
        return [message.effective_tick - self._latency for message in messages if isinstance(message, DriveForce)]

    def attend(self, data: bytes) -> None:
        answer = self.board.exchange(data)
        if answer:
            self.link.send(answer)


class BareHost(Line):
    """A process that sends back the end of what it reads.  Its board is armed, and free of any watchdog."""

    def __init__(self, board: Board) -> None:
        super().__init__(board)
        host = Transmitter()
        board.exchange(host.encode(Hello(SPEC.protocol, SPEC.hash), 0) + host.encode(Arm(), 0))

    def mark(self, said: bytes) -> bytes:
        return said[-ANSWER_LENGTH:]

    def marks(self, data: bytes) -> list[bytes | int]:
        return [data[at : at + ANSWER_LENGTH] for at in range(0, len(data), ANSWER_LENGTH)]

    def attend(self, data: bytes) -> None:
        """Nothing: the board is not spoken to."""


def segment(line: Line, ticks: int, period_s: float) -> None:
    """`ticks` ticks at absolute deadlines, each answered or not until the next."""
    board, link = line.board, line.link
    watched = [link.fileno()]
    origin = time.monotonic() + LEAD_S
    for tick in range(ticks + 1):
        deadline = origin + tick * period_s
        while True:
            left = deadline - time.monotonic()
            if not select.select(watched, (), (), max(left, 0.0))[0]:
                break
            line.receive()
            if left <= 0.0:
                break
        if tick:
            line.end_of_tick()
        if tick == ticks:
            return
        if board.streaming:
            line.tick()
            board.prepare()
        else:  # in SAFE the mass swings on, until the host arms again
            board.coast(1)


def serve(scenario: Scenario, seed: int, segment_s: float) -> tuple[RealHost, BareHost, list[NDArray[np.float64]]]:
    """Serve both until the real host leaves; the truth of its board in pages of rows."""
    pages: list[NDArray[np.float64]] = []
    clocks = (ClockMode.PACED,)
    device = Device(scenario, seed, lambda _, rows: pages.append(rows.copy()))
    real = RealHost(Board(scenario, device, clocks), scenario.drive.latency_samples)
    bare = BareHost(Board(scenario, Device(scenario, seed), clocks))
    print(json.dumps([real.link.path, bare.link.path]), flush=True)
    rate = scenario.board.sample_rate_Hz
    try:
        while not real.board.streaming:
            select.select([real.link.fileno()], (), ())
            real.receive()
        for refused in realtime.settle():
            print(f"pacer: {refused}", file=sys.stderr)
        realtime.urgent(True)
        real.link.drop_when_full = bare.link.drop_when_full = True
        while True:
            for line in (real, bare):
                segment(line, round(segment_s * rate), 1.0 / rate)
    except LinkClosed:
        realtime.urgent(False)
    device.close()
    return real, bare, pages


def main(order: dict[str, Any]) -> None:
    """Serve as ordered, write the truth, print the figures."""
    end_with_parent()
    scenario = load(Path(order["scenario"]))
    real, bare, pages = serve(scenario, order["seed"], order["segment_s"])
    truth = TruthFile(Path(order["truth"]), truth_metadata(scenario, order["seed"]))
    truth.add(0, np.concatenate(pages))
    truth.close()
    print(json.dumps({"real": real.figures(), "bare": bare.figures()}), flush=True)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
