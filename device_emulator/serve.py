"""Serving a board on a link: waiting for the host, and on wall time keeping the deadlines of the ticks.

Every wait is one `select` on the line and the stop signal until the next deadline; deadlines are absolute, so
a late one does not move the next. A host that hangs up ends a lockstep board; a paced board goes to SAFE, its
mass swings on, and the next host is awaited.
"""

import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from device_emulator import realtime
from device_emulator.board import Board
from device_emulator.line import Line, Unplugged
from device_emulator.outbox import Outbox
from hil.wire.errors import LinkClosed
from hil.wire.link import BoardLink
from hil.wire.messages import State

IDLE_S = 0.5
"""Longest wait; how often a board looks whether its parent is still there."""

COAST_S = 0.02
"""How often the mass of a paced board in SAFE is brought up to date."""

_LEAD_S = 0.005  # from ARM to the first tick

Frame = TypeVar("Frame")


class Server:
    """Serves one board on one link until it is told to stop, its parent dies, or a lockstep host hangs up.

    `sample_rate_Hz` counts in true time; a `line` with faults stands between board and link.
    """

    def __init__(self, board: Board, link: BoardLink, sample_rate_Hz: float, line: Line | None = None) -> None:
        self._board = board
        self._link = link
        self._outbox = Outbox(link)
        self._line = line
        self._source = board if line is None else line
        self._rate_Hz = sample_rate_Hz
        self._origin: float | None = None  # wall time of tick 0, once a paced board has streamed
        self._urgent = False
        self._overtaken = False  # samples are made that came due while this process stood still

    def run(self, stop: int, parent: int) -> str:
        """Serve; why it is over, "" where it was told to end. `stop` is the descriptor of `stop_signal`, `parent` the
        process that this one ends with: its parent may have died before it got here.
        """
        while os.getppid() == parent:
            try:
                if not self._turn(stop):
                    return ""
            except Unplugged:
                return "the scenario unplugs the board"
            except LinkClosed:
                self._outbox.clear()
                if self._line is not None:
                    self._line.hang_up()
                if self._board.registers.lockstep:
                    return "the host hung up, and in lockstep the board ends with it"
                self._board.hang_up()
                self._link.await_host()
        return ""

    def _turn(self, stop: int) -> bool:
        """Listen until the next deadline and do what is due then; False when told to stop."""
        board = self._board
        paced = not board.registers.lockstep
        self._be_urgent(paced and board.streaming)
        if paced and self._stood_still():
            self._send_block()
            return True
        if not paced:
            self._origin = None
            deadline = time.monotonic() + IDLE_S
        elif board.streaming:
            if self._origin is None:
                self._origin = time.monotonic() + _LEAD_S - board.rows / self._rate_Hz
            deadline = self._origin + (board.rows + board.missing - 1) / self._rate_Hz
        else:
            if self._origin is None and board.rows > 0:  # it waited for its host until now: ticks go on from here
                self._origin = time.monotonic() - (board.rows - 1) / self._rate_Hz
            deadline = time.monotonic() + (IDLE_S if self._origin is None else COAST_S)
        heard = self._listen(stop, deadline)
        if heard is None:
            return False
        if heard or not paced:
            return True
        if board.streaming:
            self._send_block()
            board.prepare()
        elif self._origin is not None:
            self._catch_up()
        return True

    def _stood_still(self) -> bool:
        """Whether this process itself stood still, as does the whole machine, for as long as the watchdog of a board
        that drives. The samples that came due meanwhile are made before anything is heard: a board would have sent them
        to a host that said nothing in their time, and so its watchdog trips.
        """
        board = self._board
        if board.state is not State.RUNNING or self._origin is None:
            self._overtaken = False
            return False
        behind = (time.monotonic() - self._origin) * self._rate_Hz - board.rows
        self._overtaken = behind >= board.registers.watchdog or (self._overtaken and behind > board.registers.block)
        return self._overtaken

    def _send_block(self) -> None:
        """The next SENSE. What a host in force mode has not taken by now is stale; a stream may wait its turn."""
        board = self._board
        said = self._source.block()
        if not board.registers.gain_mode:
            self._link.send(said)
        elif not self._outbox.put(said, droppable=board.streaming):
            board.dropped += 1

    def _listen(self, stop: int, deadline: float) -> bool | None:
        """Answer the host until the deadline. True if that changed what is due, None when told to stop."""
        board, link = self._board, self._link
        before = board.streaming, board.registers.lockstep
        while True:
            left = deadline - time.monotonic()
            due = left if self._line is None else min(left, self._line.due_s() - time.monotonic())
            full = (link.fileno(),) if self._outbox else ()
            ready, room, _ = select.select((link.fileno(), stop), full, (), max(due, 0.0))
            if not (ready or room) and due >= left:
                return False
            if stop in ready:
                return None
            if room:
                self._outbox.flush()
            if room and not ready:
                if left <= 0.0:
                    return False
                continue
            self._pass_time()
            self._say(self._source.exchange(link.receive(0.0)))
            if (board.streaming, board.registers.lockstep) != before:
                return True
            if left <= 0.0:
                return False

    def _pass_time(self) -> None:
        """Bring a board that streams nothing, or that closes the loop itself, to the present before it hears what is
        said now: what it answers holds at the present tick.
        """
        board = self._board
        if self._origin is None:
            return
        if not board.streaming:
            self._catch_up()
        elif board.registers.gain_mode:
            self._say(self._source.pass_time(int((time.monotonic() - self._origin) * self._rate_Hz)))

    def _say(self, data: bytes) -> None:
        """Answers; behind what waits already, where a stream may have to wait."""
        if self._outbox or (self._urgent and self._board.registers.gain_mode):
            self._outbox.put(data)
        elif data:
            self._link.send(data)

    def _catch_up(self) -> None:
        """Bring the mass, which nobody watched or drove, to the present; before other processes, or on a busy machine a
        fast board falls further behind the longer it takes, and answers nobody.
        """
        assert self._origin is not None
        behind = int((time.monotonic() - self._origin) * self._rate_Hz) + 1 - self._board.rows
        if behind > 0:
            realtime.urgent(True)
            try:
                self._say(self._board.coast(behind))
            finally:
                realtime.urgent(self._urgent)

    def _be_urgent(self, urgent: bool) -> None:
        if urgent == self._urgent:
            return
        self._urgent = urgent
        self._link.drop_when_full = urgent and not self._board.registers.gain_mode
        if urgent and self._origin is None:
            for refused in realtime.settle():
                print(f"device_emulator: {refused}", file=sys.stderr)
        realtime.urgent(urgent)


def send_paced(
    samples: Callable[[float], Iterator[Sequence[Frame]]],
    rate_Hz: float,
    send: Callable[[Sequence[Frame]], object],
    stop: int,
) -> None:
    """Send the frames of so many samples a second, by absolute deadlines, until `stop` can be read; `samples` are those
    from a time of the monotonic clock on, the first of them a sample later."""
    origin, sent = time.monotonic(), 0
    coming = samples(origin)
    while not select.select((stop,), (), (), 0.5 / rate_Hz)[0]:
        due = int((time.monotonic() - origin) * rate_Hz) - sent
        if due > 0:
            send([frame for _ in range(due) for frame in next(coming)])
            sent += due


@contextmanager
def stop_signal() -> Iterator[int]:
    """A descriptor that becomes readable when the process is asked to end."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    numbers = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
    before = [signal.signal(number, lambda *_: None) for number in numbers]
    wakeup = signal.set_wakeup_fd(writing)
    try:
        yield reading
    finally:
        signal.set_wakeup_fd(wakeup)
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
        os.close(reading)
        os.close(writing)
