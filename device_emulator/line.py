"""The line between board and link, and what the scenario's `[faults]` do to the frames on it.

It stands in the place of the board's `exchange` and `block` and sees only whole frames, so it is the same on
every link. Each frame meets at most one fate, drawn from a stream of its own per direction.

On wall time the line lets go of a frame when its time has come. In lockstep time is bench time: what arrives
before the next tick arrives at once, and the line, which knows what it has done, says when a tick passes without
an answer: when the SENSE of that tick, or the drive that answered it, did not get through in time. The board then
goes on as it would on wall time, holding its last drive. Requests and their answers pass unharmed in lockstep,
because no time passes while somebody waits for one.
"""

import heapq
import itertools
import math
import time
from collections import Counter
from typing import NamedTuple

import numpy as np

from device_emulator.board import Board
from device_emulator.faults import Faults, Spell
from device_emulator.scenario import Scenario
from hil.wire.codec import type_of
from hil.wire.errors import LinkClosed
from hil.wire.frame_format import FrameFormat
from hil.wire.messages import DriveForce, DriveGains
from hil.wire.sense import Sense

_SENSE = type_of(Sense)
_DRIVES = (type_of(DriveForce), type_of(DriveGains))
_STREAMED = (_SENSE, *_DRIVES)
_BITS_PER_BYTE = 10  # start, eight, stop
_MOST_FLIPS = 4
_QUEUE_BYTES = 4096  # of a slow serial line's transmit buffer; what does not fit is lost


class Unplugged(LinkClosed):
    """The scenario says that the board's end of the line is gone."""


class _Frame(NamedTuple):
    data: bytes
    kind: int | None  # message type, None if that cannot be read any more
    number: int  # in the order of sending


class _Travelling(NamedTuple):
    due_s: float
    order: int  # of arrival, among those due at once
    frame: _Frame


class _Lane:
    """One direction of the line; its times are whatever the line takes as now."""

    def __init__(self, name: str, faults: Faults, seed: int, inflicted: Counter[str], form: FrameFormat) -> None:
        self._name, self._faults, self._inflicted = name, faults, inflicted
        # What befalls samples and drives must not depend on how often somebody had to ask for something before.
        self._streams = [np.random.default_rng([seed, stream, *name.encode()]) for stream in range(2)]
        self._harmed = faults.toward in ("both", name)
        self._waiting: list[_Travelling] = []
        self._overtaken: list[_Frame] = []
        self._free_s = -math.inf
        self._numbers = itertools.count()
        self._order = itertools.count()
        self._format = form
        self._rest = b""

    @property
    def next_s(self) -> float:
        """When the next frame arrives; infinite when none is on its way."""
        return self._waiting[0].due_s if self._waiting else math.inf

    def cut(self, data: bytes) -> list[_Frame]:
        """The whole frames in a stretch of the byte stream."""
        frames, self._rest = self._format.cut(self._rest + data)
        return [_Frame(frame, self._format.kind(frame), next(self._numbers)) for frame in frames]

    def put(self, frame: _Frame, now_s: float, bench_s: float, *, exempt: bool = False) -> None:
        """Send a frame on its way, or not."""
        faults = self._faults
        if exempt:
            self._push(frame, now_s)
            return
        if faults.baud is not None:
            byte_s = _BITS_PER_BYTE / faults.baud
            if self._free_s - now_s > _QUEUE_BYTES * byte_s:
                self._inflicted[f"overrun_to_{self._name}"] += 1
                return
            self._free_s = now_s = max(now_s, self._free_s) + len(frame.data) * byte_s
        for spell in faults.stall:
            if spell.start_s <= bench_s < (end := spell.start_s + spell.duration_s):
                now_s = round(now_s + end - bench_s, 9)  # all at once, not apart by rounding
                self._inflicted[f"stalled_to_{self._name}"] += 1
        overtaken, self._overtaken = self._overtaken, []
        random = self._streams[frame.kind in _STREAMED]
        match self._fate(random, bench_s):
            case "lost":
                pass
            case "corrupted" if not self._format.sealed:
                pass  # the controller at the other end drops it
            case "corrupted":
                self._push(frame._replace(data=_flip(random, frame.data), kind=None), now_s)
            case "duplicated":
                self._push(frame, now_s)
                self._push(frame, now_s)
            case "reordered":
                self._overtaken = [frame]
            case "delayed":
                self._push(frame, now_s + random.uniform(*faults.delay_s))
            case _:
                self._push(frame, now_s)
        for late in overtaken:
            self._push(late, now_s)

    def due(self, until_s: float) -> list[_Frame]:
        """The frames that have arrived before `until_s`, in order of arrival."""
        arrived = []
        while self._waiting and self._waiting[0].due_s < until_s:
            arrived.append(heapq.heappop(self._waiting).frame)
        return arrived

    def clear(self) -> None:
        """Forget what is on its way: nobody is there to receive it."""
        self._waiting.clear()
        self._overtaken.clear()
        self._rest = b""

    def _push(self, frame: _Frame, due_s: float) -> None:
        heapq.heappush(self._waiting, _Travelling(due_s, next(self._order), frame))

    def _fate(self, random: np.random.Generator, bench_s: float) -> str:
        faults = self._faults
        if not (self._harmed and faults.from_s <= bench_s < faults.until_s):
            return ""
        drawn = random.random()
        for fate in ("lost", "corrupted", "duplicated", "reordered", "delayed"):
            drawn -= getattr(faults, fate)
            if drawn < 0.0:
                self._inflicted[f"{fate}_to_{self._name}"] += 1
                return fate
        return ""


class Line:
    """The line of one board: `exchange`, `block` and `due_s` are what a server needs.

    Attributes:
        inflicted: frames harmed so far, by fate and direction (`lost_to_host`, …), and outages.
    """

    def __init__(self, board: Board, scenario: Scenario, seed: int | None = None) -> None:
        faults = scenario.faults
        self.inflicted: Counter[str] = Counter()
        self._board = board
        self._interval_s = 1.0 / scenario.board.sample_rate_Hz
        seed = scenario.seed if seed is None else seed
        self._to_host = _Lane("host", faults, seed, self.inflicted, board.format)
        self._to_board = _Lane("board", faults, seed, self.inflicted, board.format)
        self._unplugged_s = math.inf if faults.unplugged_s is None else faults.unplugged_s
        self._brown_outs = sorted(faults.brown_out, key=lambda spell: -spell.start_s)  # the next one last
        self._off_until = 0  # tick before which the board has no supply
        self._owed = False  # a SENSE that is news has reached the host, and no drive has left it since
        self._newest = -1  # number of the last frame that was news to the host

    def exchange(self, data: bytes) -> bytes:
        """What reaches the host by now, after `data` has left it. Raises `Unplugged`."""
        board, waiting = self._board, self._board.registers.lockstep
        self._outages()
        for frame in self._to_board.cut(data):
            if frame.kind in _DRIVES:
                self._owed = False
            # Only of what a tick decides can a board that waits tell that it is not coming.
            exempt = waiting and not (frame.kind in _DRIVES and board.streaming)
            now_s = self._bench_s if board.registers.lockstep else time.monotonic()
            self._to_board.put(frame, now_s, self._bench_s, exempt=exempt)
        return self._lockstep() if board.registers.lockstep else self._carry()

    def block(self) -> bytes:
        """Go on by one block of ticks on wall time; what reaches the host by now. Raises `Unplugged`."""
        self._outages()
        if self._board.streaming:
            self._say(self._board.block())
        return self._carry()

    def pass_time(self, tick: int) -> bytes:
        """As `Board.pass_time`; what of it reaches the host by now."""
        self._say(self._board.pass_time(tick))
        return self._carry()

    def due_s(self) -> float:
        """Monotonic time at which something arrives at either end, on wall time."""
        if self._board.registers.lockstep:
            return math.inf
        return min(self._to_host.next_s, self._to_board.next_s)

    def hang_up(self) -> None:
        """The host is gone, and what was on its way to it or from it with it."""
        self._to_host.clear()
        self._to_board.clear()
        self._owed = False

    @property
    def _bench_s(self) -> float:
        return self._board.tick * self._interval_s

    def _carry(self) -> bytes:
        """Bring over, on wall time, what has arrived at either end."""
        for frame in self._to_board.due(_just_after(time.monotonic())):
            self._hear(frame)
        return b"".join(frame.data for frame in self._to_host.due(_just_after(time.monotonic())))

    def _lockstep(self) -> bytes:
        """Exchange frames and let ticks pass until the host owes an answer, or the board has nothing to stream."""
        board, arrived = self._board, b""
        while True:
            rows = board.rows
            for frame in self._to_board.due(max(board.rows, 1) * self._interval_s):
                self._hear(frame)
            for frame in self._one_sample(self._to_host.due(max(board.rows, 1) * self._interval_s)):
                arrived += frame.data
                if frame.kind is not None and frame.number > self._newest:
                    self._newest = frame.number
                    self._owed = self._owed or frame.kind == _SENSE
            if self._owed or not (board.streaming and board.registers.lockstep):
                return arrived
            if board.rows == rows:
                self._say(board.block())

    def _one_sample(self, arrived: list[_Frame]) -> list[_Frame]:
        """What arrives before one tick, of several samples only the newest: whether a host gets them in one piece or in
        several must not decide how many of them it answers.
        """
        news = [frame for frame in arrived if frame.kind == _SENSE and frame.number > self._newest]
        if len(news) < 2:
            return arrived
        newest = arrived.index(max(news, key=lambda frame: frame.number))
        kept = [frame for frame in arrived[:newest] if frame not in news] + arrived[newest:]
        self.inflicted["overtaken_to_host"] += len(arrived) - len(kept)
        return kept

    def _hear(self, frame: _Frame) -> None:
        if self._board.rows >= self._off_until:
            self._say(self._board.exchange(frame.data))

    def _say(self, data: bytes) -> None:
        lockstep, bench_s = self._board.registers.lockstep, self._bench_s
        now_s = bench_s if lockstep else time.monotonic()
        for frame in self._to_host.cut(data):
            self._to_host.put(frame, now_s, bench_s, exempt=lockstep and frame.kind != _SENSE)

    def _outages(self) -> None:
        """Pull the plug or take the supply away, when it is time to."""
        if self._bench_s >= self._unplugged_s:
            self.inflicted["unplugged"] = 1
            self._board.hang_up()
            raise Unplugged("the line was unplugged, as the scenario says")
        while self._brown_outs and self._bench_s >= self._brown_outs[-1].start_s:
            self._fail_supply(self._brown_outs.pop())

    def _fail_supply(self, spell: Spell) -> None:
        """In lockstep the time without supply passes at once: nobody can wait for its end."""
        self.inflicted["brown_out"] += 1
        lockstep, ticks = self._board.registers.lockstep, math.ceil(spell.duration_s / self._interval_s)
        self._board.power_up()
        self._to_host.clear()
        if lockstep:
            self._board.coast(ticks)
        else:
            self._off_until = self._board.rows + ticks


def _flip(random: np.random.Generator, data: bytes) -> bytes:
    damaged = bytearray(data)
    flips = random.integers(1, _MOST_FLIPS, endpoint=True)
    for bit in random.choice(8 * len(data), flips, replace=False):
        damaged[bit >> 3] ^= 1 << (bit & 7)
    return bytes(damaged)


def _just_after(now_s: float) -> float:
    return math.nextafter(now_s, math.inf)
