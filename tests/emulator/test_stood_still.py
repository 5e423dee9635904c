"""A machine that is suspended with its emulated board: no drive came in the time of the samples, however soon the host
answers then.  The clock is by hand, and the host answers within no time at all.
"""

from types import SimpleNamespace
from typing import Any

import pytest

from device_emulator import realtime, serve
from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.scenario import load
from device_emulator.serve import Server
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.link import BoardLink, Link
from hil.wire.messages import ClockMode, SafeReason, State, Status
from hil.wire.sense import Sense
from tests.emulator.gyro import EXAMPLES

RATE_HZ, WATCHDOG_TICKS = 4000.0, 400  # 0.1 s


class Line(BoardLink):
    """The board's end; what it sends is kept for the host."""

    name = url = "by hand"
    drop_when_full = False

    def __init__(self) -> None:
        self.to_board, self.to_host = b"", b""

    def fileno(self) -> int:
        return 1_000_000  # nothing waits on it

    def send(self, data: bytes) -> None:
        self.to_host += data

    def offer(self, data: bytes | memoryview) -> int:
        self.send(bytes(data))
        return len(data)

    def receive(self, timeout_s: float | None) -> bytes:
        data, self.to_board = self.to_board, b""
        return data

    def close(self) -> None:
        return

    def await_host(self) -> None:
        raise AssertionError


class HostEnd(Link):
    """The host's end; before the board is served, it answers at once."""

    name = "by hand"

    def __init__(self, line: Line, board: Board) -> None:
        self._line, self.board = line, board
        self.served = False

    def fileno(self) -> None:
        return

    def send(self, data: bytes) -> None:
        if self.served:
            self._line.to_board += data
        else:
            self._line.to_host += self.board.exchange(data)

    def receive(self, timeout_s: float | None) -> bytes:
        data, self._line.to_host = self._line.to_host, b""
        return data

    def close(self) -> None:
        return


class Bench:
    """A board on wall time with its host, and their clock."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 1000.0
        self.line = Line()
        scenario = load(EXAMPLES / "s-slow.scenario.toml")
        self.board = Board(scenario, Device(scenario, 1, None), (ClockMode.PACED,))
        monkeypatch.setattr(serve, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        monkeypatch.setattr(serve, "select", SimpleNamespace(select=self._select))
        monkeypatch.setattr(Server, "_be_urgent", lambda *_: None)
        self._server = Server(self.board, self.line, RATE_HZ)
        end = HostEnd(self.line, self.board)
        self.host = Endpoint(end)
        client.connect(self.host)
        client.write_register(self.host, "CLOCK_MODE", ClockMode.PACED)
        client.write_register(self.host, "WATCHDOG_TICKS", WATCHDOG_TICKS)
        client.arm(self.host)
        end.served = True
        self.safe: Status | None = None
        self.answered = 0

    def _select(self, ready: Any, room: Any, _: Any, timeout_s: float) -> tuple[list[int], list[int], list[int]]:
        if self.line.to_board:
            return [self.line.fileno()], [], []
        self.now_s += timeout_s
        return [], [], []

    def run(self, seconds: float) -> None:
        """Serve, every sample answered at once, until then or until the board is SAFE."""
        until_s = self.now_s + seconds
        while self.now_s < until_s and self.safe is None:
            self._server._turn(-1)
            for received in self.host.poll(0.0):
                if isinstance(received.message, Sense):
                    self.answered = received.tick
                    self.host.send_drive(10, -10, received.tick + 1)
                elif isinstance(received.message, Status) and received.message.state == State.SAFE:
                    self.safe = received.message


def test_a_board_in_safe_catches_up_before_other_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its mass swings on: at 200 kS/s that takes a fifth of a processor, which a busy machine does not give."""
    bench, urgent = Bench(monkeypatch), list[bool]()
    monkeypatch.setattr(realtime, "urgent", urgent.append)
    bench.run(0.05)
    bench.now_s += 1.0
    bench.run(10.0)
    assert bench.safe is not None
    assert urgent == []
    begin = bench.board.rows
    bench._server._turn(-1)
    assert bench.board.rows > begin
    assert urgent == [True, False] * (len(urgent) // 2)
    assert urgent


@pytest.mark.parametrize("stopped_s", [0.02, 0.09])
def test_a_stop_shorter_than_the_watchdog_is_caught_up_with(monkeypatch: pytest.MonkeyPatch, stopped_s: float) -> None:
    bench = Bench(monkeypatch)
    for _ in range(3):
        bench.run(0.05)
        bench.now_s += stopped_s
    bench.run(0.2)
    assert bench.safe is None
    assert bench.board.status().watchdog_trips == 0


@pytest.mark.parametrize("stopped_s", [0.11, 1.0, 3600.0])
def test_a_stop_as_long_as_the_watchdog_trips_it(monkeypatch: pytest.MonkeyPatch, stopped_s: float) -> None:
    """At the sample at which the watchdog of a board that had not stood still would have tripped."""
    bench = Bench(monkeypatch)
    bench.run(0.05)
    last = bench.answered
    assert bench.board.status().watchdog_trips == 0
    bench.now_s += stopped_s
    bench.run(10.0)
    assert bench.safe is not None
    assert bench.safe.reason == SafeReason.WATCHDOG
    assert last + WATCHDOG_TICKS <= bench.safe.tick <= last + WATCHDOG_TICKS + 2
