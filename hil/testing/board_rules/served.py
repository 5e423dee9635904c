"""A board that is served somewhere, the host's end of its link, and what a host does with it in tests of the wire."""

import subprocess
import time
from collections.abc import Callable
from typing import Any

import pytest

from hil.running.safety.asked_again import zero_drive
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed, WireError
from hil.wire.link import Link
from hil.wire.links import open_link
from hil.wire.messages import (
    Capabilities,
    ClockMode,
    DriveBoard,
    DriveForce,
    DriveGains,
    Identity,
    LoopMode,
    NackReason,
    SafeReason,
    State,
    Status,
)
from hil.wire.sense import SenseRow
from hil.wire.spec import SPEC, Register

_DRIVE = {LoopMode.FORCE: DriveForce, LoopMode.GAIN: DriveGains, LoopMode.BOARD: DriveBoard}
PATIENCE_S = 5.0
QUIET_S = 0.3
"""Long enough for an answer that must not come."""


class Board:
    """A board to be spoken to at `url`: a process that said `ready URL`, or one that is simply there.

    `start` makes the process, as `subprocess.Popen` does.
    """

    def __init__(
        self, command: list[str] | None = None, url: str = "", start: type[subprocess.Popen[str]] = subprocess.Popen
    ) -> None:
        self.url = url
        self.process: subprocess.Popen[str] | None = None
        if command is not None:
            self.process = start(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            assert self.process.stdout is not None
            line = self.process.stdout.readline().strip()
            ready, _, self.url = line.partition(" ")
            assert ready == "ready", f"expected a line 'ready LINK', got {line!r} {self.end()}"

    def open(self) -> Link:
        """The host's end."""
        return open_link(self.url)

    def end(self) -> str:
        """Kill the process; what it wrote to standard error."""
        if self.process is None:
            return ""
        self.process.kill()
        return self.process.communicate()[1]


class Cable(Link):
    """A link whose frames a test can tamper with on the way: `outgoing` and `incoming` take frames, return frames."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self.name, self.format, self.advice = link.name, link.format, link.advice
        self.outgoing: Callable[[list[bytes]], list[bytes]] = list
        self.incoming: Callable[[list[bytes]], list[bytes]] = list
        self._part = b""

    def fileno(self) -> int | None:
        return self._link.fileno()

    def send(self, data: bytes) -> None:
        for frame in self.outgoing(self.format.cut(data)[0]):
            self._link.send(frame)

    def receive(self, timeout_s: float | None) -> bytes:
        frames, self._part = self.format.cut(self._part + self._link.receive(timeout_s))
        return b"".join(self.incoming(frames))

    def close(self) -> None:
        self._link.close()


def answers(host: Endpoint, count: int, wait_s: float = PATIENCE_S) -> list[Any]:
    """The next `count` messages beside samples, or what came within the time."""
    found: list[Any] = []
    until = time.monotonic() + wait_s
    while len(found) < count and time.monotonic() < until:
        found += [item.message for item in host.poll(0.02) if not hasattr(item.message, "codes")]
    return found


class NotSafe(Exception):
    """The board cannot be brought to SAFE, or takes a drive there: what was expected and what came."""


def require_safe(host: Endpoint) -> None:
    """Bring the board to SAFE, and see that it takes no drive there: one of zero, of the loop mode that is set.

    Raises NotSafe; LinkClosed where the board hung up.
    """
    try:
        status_of(host)
        mode = LoopMode(int(client.read_register(host, "LOOP_MODE", PATIENCE_S)))
    except LinkClosed:
        raise
    except WireError as error:
        raise NotSafe(f"expected SAFE, came: {error}") from None
    try:
        client.request(
            host, zero_drive(_DRIVE[mode], host.rx.tick), Status, PATIENCE_S, lambda told: told.state == State.RUNNING
        )
        came = "RUNNING"
    except client.Refused as refused:
        if refused.reason == NackReason.BAD_STATE:
            return
        came = str(refused)
    except LinkClosed:
        raise
    except WireError:
        came = "no refusal"
    raise NotSafe(f"expected that it refuses a drive in SAFE, came {came}: it says SAFE and stays driven")


def status_of(host: Endpoint) -> Status:
    """The board's counters, by way of SAFE for the reason that does not latch: a board in SAFE it leaves as it is."""
    return client.make_safe(host, SafeReason.LINK_LOST, PATIENCE_S)


def registers_of(host: Endpoint) -> dict[str, Register]:
    """The registers that the board has: all but those of optional parts that it does not name."""
    able = Capabilities(client.connect(host, PATIENCE_S).capabilities)
    return {
        name: register
        for name, register in SPEC.registers.items()
        if not register.optional or Capabilities[register.optional] in able
    }


def set_loop_mode(host: Endpoint, mode: LoopMode) -> None:
    """Write LOOP_MODE; skips the rule where the board does not name the mode."""
    if Capabilities[f"{mode.name}_MODE"] not in Capabilities(client.connect(host, PATIENCE_S).capabilities):
        pytest.skip(f"this board has no {mode.name.lower()} mode")
    client.write_register(host, "LOOP_MODE", mode, PATIENCE_S)


def leave(host: Endpoint) -> None:
    """Part with a board so that it is there for the next host: one in lockstep may end with this one."""
    require_safe(host)
    if Capabilities.PACED in Capabilities(client.connect(host, PATIENCE_S).capabilities):
        client.write_register(host, "CLOCK_MODE", ClockMode.PACED, PATIENCE_S)


def samples(host: Endpoint) -> list[SenseRow]:
    """The next samples, however many."""
    until = time.monotonic() + PATIENCE_S
    while not (rows := host.receive_rows(0.5)):
        assert time.monotonic() < until, "expected a sample, came none"
    return rows


def drive(host: Endpoint, identity: Identity, rows: int) -> None:
    """Answer so many samples with drives that differ, and check that each comes back where it acted."""
    sent: dict[int, tuple[int, int]] = {}
    seen = 0
    expected: int | None = None
    checked = 0
    while seen < rows:
        for tick, _, _, ux, uy, _ in samples(host):
            assert expected in (None, tick), f"expected sample {expected}, came {tick}"
            expected = tick + 1
            seen += 1
            if tick - 1 in sent:
                assert (ux, uy) == sent.pop(tick - 1)
                checked += 1
            codes = seen % 13 - 6, 5 - seen % 11
            host.send_drive(*codes, tick + identity.latency_ticks)
            sent[tick + identity.latency_ticks] = codes
    assert checked >= rows - identity.latency_ticks - 2


def set_running(host: Endpoint) -> int:
    """Drive an armed board until it says RUNNING; the tick of the newest sample. How far ahead a drive must point
    depends on how old samples are when they arrive, how far it may, on the board; a busy machine misses some."""
    for ahead in (1, 2, 4, 8, 16, 32, 64, 128, 256, 512) * 5:
        tick = samples(host)[-1][0]
        while rows := host.receive_rows(0.0):  # what had piled up
            tick = rows[-1][0]
        host.send_drive(1, 1, tick + ahead)
        heard = [item.message for item in host.poll(0.02)]
        if any(isinstance(message, Status) and message.state == State.RUNNING for message in heard):
            return tick
    raise AssertionError("expected RUNNING after a drive in time, came no such STATUS")
