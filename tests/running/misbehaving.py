"""A board of its own on a pty, in force mode, written from docs/wire.md and docs/safety.md; and how boards misbehave.

It shares the codec with the bench and nothing with the emulator.  `Board` keeps the rules; each misbehaviour below
breaks one.  `driven` is what its drive stage really does, whatever it says.
"""

import math
import random
import select
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Self

import numpy as np

from hil.wire.codec import field_value, type_of
from hil.wire.errors import LinkClosed
from hil.wire.messages import (
    Arm,
    DriveForce,
    FieldRead,
    Hello,
    Identity,
    Message,
    Nack,
    NackReason,
    RegisterRead,
    RegisterValue,
    RegisterWrite,
    Safe,
    SafeReason,
    SenseFlags,
    State,
    Status,
    TimeSync,
)
from hil.wire.pty_link import PtyLink, open_pty
from hil.wire.sense import Sense
from hil.wire.serial_format import SERIAL
from hil.wire.spec import SPEC
from hil.wire.stream import Received, Receiver, Transmitter

RATE_HZ = 400.0
GAIN_V_PER_M = -885.42
FULL_V = 0.25
FULL_MPS2 = 0.1
LATCHED = 8

_REGISTERS = {register.id: register for register in SPEC.registers.values()}
_NUMBER = {name: register.id for name, register in SPEC.registers.items()}
_LATCHING = (SafeReason.HOST_REQUEST, SafeReason.INTERRUPTED, SafeReason.RESIDUAL, SafeReason.FAULT)


class _Oscillator:
    """One axis: a damped oscillator under a force that is constant over a tick, solved exactly."""

    def __init__(self, stiffness: float, damping: float, x: float) -> None:
        self._k, self._d = stiffness, damping
        self.x, self.v = x, 0.0

    def step(self, force: float, seconds: float) -> None:
        rest = force / self._k
        decay, omega = 0.5 * self._d, math.sqrt(self._k - 0.25 * self._d**2)
        x, v = self.x - rest, self.v
        c, s, fade = math.cos(omega * seconds), math.sin(omega * seconds), math.exp(-decay * seconds)
        self.x = rest + fade * (x * c + (v + decay * x) / omega * s)
        self.v = fade * (v * c - (self._k * x + decay * v) / omega * s)


class Board:
    """A board that behaves. As a context manager it serves in a thread of its own; `url` is where.

    Attributes:
        arms, safes: how many ARM and SAFE frames it has heard.
        driven: time (monotonic) and codes of every tick with a drive that is not zero.
        safe_heard_s: when the first SAFE after an ARM came.
    """

    def __init__(self) -> None:
        self._link: PtyLink = open_pty()
        self.url = self._link.url
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._noise = random.Random(1)
        self._axes = _Oscillator(16000.0, 0.13, 1e-4), _Oscillator(15500.0, 0.12, 0.0)
        self.identity = Identity(
            SPEC.protocol, SPEC.hash, 0xBAD, 1, RATE_HZ, 2, 16, 16, FULL_V / 2**15, FULL_MPS2 / 2**15, 1, 13
        )
        self.tick = -1
        self.arms = self.safes = 0
        self.driven: list[tuple[float, int, int]] = []
        self.safe_heard_s: float | None = None
        self.power_up()

    def power_up(self) -> None:
        """As after switching on."""
        self.rx, self.tx = Receiver(), Transmitter()
        self.state, self.reason = State.BOOT, SafeReason.NONE
        self.latched = self.greeted = False
        self.values = {number: float(register.default) for number, register in _REGISTERS.items()}
        self.held = (0, 0)
        self.waiting: dict[int, tuple[int, int]] = {}
        self.flags = 0  # of the row to come
        self.due: int | None = None  # tick of the first drive since ARM
        self.fed = 0
        self.trips = 0

    # ------------------------------------------------------------------------------------------------ what it does

    def stop(self, reason: SafeReason) -> None:
        """To SAFE: the force is gone at once."""
        self.state, self.reason = State.SAFE, reason
        self.latched = self.latched or reason in _LATCHING
        self.held, self.waiting = (0, 0), {}

    def each_tick(self) -> None:
        """Before a tick: where a misbehaviour begins."""

    def say_row(self, tick: int, vx: int, vy: int, ux: int, uy: int) -> bytes:
        return self.tx.encode(Sense(np.array([(vx, vy, ux, uy)], np.int32), 2, self.flags), tick)

    def say_status(self) -> list[Message]:
        tick = max(self.tick, 0) & 0xFFFFFFFF
        return [Status(self.state, self.reason, 0, 0, self.rx.bad, self.rx.lost, 0, self.trips, 0, tick)]

    def on_hello(self, hello: Hello) -> list[Message]:
        self.greeted = hello.protocol == SPEC.protocol and hello.spec_hash == SPEC.hash
        if self.streaming:
            self.stop(SafeReason.LINK_LOST)
        elif self.state is State.BOOT:
            self.state = State.IDLE
        self.latched = self.latched and self.reason is SafeReason.FAULT
        return [self.identity]

    def on_arm(self) -> list[Message]:
        self.arms += 1
        if self.state is State.ARMED:
            return self.say_status()
        if self.state not in (State.IDLE, State.SAFE) or not self.greeted:
            return [Nack(type_of(Arm), self._seq, NackReason.BAD_STATE)]
        if self.latched:
            return [Nack(type_of(Arm), self._seq, LATCHED)]
        self.state, self.reason = State.ARMED, SafeReason.NONE
        self.due = None
        return self.say_status()

    def on_safe(self, safe: Safe) -> list[Message]:
        self.safes += 1
        if self.arms and self.safe_heard_s is None:
            self.safe_heard_s = time.monotonic()
        if self.state is not State.SAFE or (not self.latched and safe.reason != SafeReason.LINK_LOST):
            self.stop(SafeReason(safe.reason))
        return self.say_status()

    def on_drive(self, drive: DriveForce) -> list[Message]:
        if not self.streaming:
            return [Nack(type_of(DriveForce), self._seq, NackReason.BAD_STATE)]
        ahead = (drive.effective_tick - self.tick) & 0xFFFFFFFF
        if ahead > 1000:
            return []
        limit = int(min(self.values[_NUMBER["DRIVE_LIMIT"]], 2**15 - 1))
        self.waiting[self.tick + ahead] = (max(-limit, min(drive.ux, limit)), max(-limit, min(drive.uy, limit)))
        self.fed = self.tick
        if self.state is State.RUNNING:
            return []
        self.state, self.due = State.RUNNING, self.tick + ahead
        return self.say_status()

    def on_read(self, number: int) -> list[Message]:
        return [RegisterValue(number, self.values[number])]

    def on_write(self, number: int, value: float) -> list[Message]:
        if not _REGISTERS[number].accepts(value):
            return [Nack(type_of(RegisterWrite), self._seq, NackReason.OUT_OF_RANGE)]
        if not _REGISTERS[number].live and self.state not in (State.IDLE, State.SAFE):
            return [Nack(type_of(RegisterWrite), self._seq, NackReason.BAD_STATE)]
        self.values[number] = value
        return [RegisterValue(number, value)]

    def on_time(self, sync: TimeSync) -> list[Message]:
        return [sync._replace(board_ns=time.monotonic_ns())]

    # ---------------------------------------------------------------------------------------------- how it serves

    @property
    def streaming(self) -> bool:
        return self.state in (State.ARMED, State.RUNNING)

    @property
    def lockstep(self) -> bool:
        return self.values[_NUMBER["CLOCK_MODE"]] == 0

    def row(self) -> bytes:
        """Go on by one tick."""
        self.each_tick()
        if self.state is State.RUNNING and self.tick - self.fed >= self.values[_NUMBER["WATCHDOG_TICKS"]]:
            self.trips += 1
            self.stop(SafeReason.WATCHDOG)
            return self._frames(self.say_status())
        due = self.due is not None and self.tick >= self.due and self.state is State.RUNNING
        self.flags = SenseFlags.HELD if due and self.tick not in self.waiting else 0
        self.held = self.waiting.pop(self.tick, self.held)
        ux, uy = self.held
        if ux or uy:
            self.driven.append((time.monotonic(), ux, uy))
        codes = []
        for axis, code in zip(self._axes, (ux, uy), strict=True):
            axis.step(code * FULL_MPS2 / 2**15, 1.0 / RATE_HZ)
            volts = GAIN_V_PER_M * axis.x + self._noise.gauss(0.0, 8.9e-5)
            codes.append(max(-(2**15), min(round(volts / FULL_V * 2**15), 2**15 - 1)))
        self.tick += 1
        return self.say_row(self.tick, *codes, ux, uy) if self.streaming else b""

    def answer(self, item: Received) -> list[Message]:
        self._seq = item.seq
        match item.message:
            case Hello():
                return self.on_hello(item.message)
            case Arm():
                return self.on_arm()
            case Safe():
                return self.on_safe(item.message)
            case DriveForce():
                return self.on_drive(item.message)
            case RegisterRead(number):
                return self.on_read(number)
            case RegisterWrite(number, value):
                return self.on_write(number, value)
            case FieldRead(line):
                return [field_value(line)]
            case TimeSync():
                return self.on_time(item.message)
        return []

    def _frames(self, messages: list[Message]) -> bytes:
        return b"".join(self.tx.encode(message, max(self.tick, 0)) for message in messages)

    def _serve(self) -> None:
        due = time.monotonic()
        while not self._stop.is_set():
            pending = self.streaming and not self.lockstep
            left = max(due - time.monotonic(), 0.0) if pending else 0.02
            try:
                if not select.select([self._link.fileno()], [], [], left)[0]:
                    if pending:
                        due += 1.0 / RATE_HZ
                        self._link.offer(self.row())
                    else:
                        due = time.monotonic()
                    continue
                for item in self.rx.feed(self._link.receive(0.0)):
                    was_armed = self.state is State.ARMED
                    self._link.offer(self._frames(self.answer(item)))
                    closing = isinstance(item.message, DriveForce) or (isinstance(item.message, Arm) and not was_armed)
                    if self.lockstep and self.streaming and closing:
                        self._link.offer(self.row())
            except LinkClosed:
                if self.streaming:
                    self.stop(SafeReason.LINK_LOST)
                self._link.await_host()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._link.close()


AT = 480
"""Tick at which most of them begin: 1.2 s, so that the loop has been closed for 0.2 s."""


class StopsItself(Board):
    """Goes to SAFE by itself and says why; the fault is gone at once, so that it could be armed again."""

    why = SafeReason.FAULT

    def __init__(self, why: SafeReason = SafeReason.FAULT) -> None:
        super().__init__()
        self.why = why

    def each_tick(self) -> None:
        if self.tick == AT and self.streaming:
            self.stop(self.why)
            self.latched = False
            self._link.offer(self._frames(self.say_status()))


class StopsItselfAndStreams(StopsItself):
    """Says FAULT, and streams on as if nothing were."""

    said = False

    def each_tick(self) -> None:
        if self.tick >= AT and not self.said:
            self.said = True
            status = self.say_status()[0]
            assert isinstance(status, Status)
            self._link.offer(self._frames([status._replace(state=State.SAFE, reason=SafeReason.FAULT)]))


class Deaf(Board):
    """Ignores SAFE and drives on."""

    def on_safe(self, safe: Safe) -> list[Message]:
        self.safes += 1
        self.safe_heard_s = self.safe_heard_s or time.monotonic()
        return []

    def on_hello(self, hello: Hello) -> list[Message]:
        self.greeted = True
        self.state = State.IDLE if self.state is State.BOOT else self.state
        return [self.identity]


class Obeys(Board):
    """Stops at SAFE and says nothing of it, nor of anything else from then on."""

    def on_safe(self, safe: Safe) -> list[Message]:
        super().on_safe(safe)
        return []


class Liar(Deaf):
    """Says SAFE and drives on."""

    def on_safe(self, safe: Safe) -> list[Message]:
        self.safes += 1
        status = self.say_status()[0]
        assert isinstance(status, Status)
        return [status._replace(state=State.SAFE, reason=SafeReason(safe.reason))]


class Talkative(Liar):
    """Drives no more in SAFE, but streams on."""

    def on_safe(self, safe: Safe) -> list[Message]:
        self.quiet = True
        return super().on_safe(safe)

    def on_drive(self, drive: DriveForce) -> list[Message]:
        if getattr(self, "quiet", False):
            return [Nack(type_of(DriveForce), self._seq, NackReason.BAD_STATE)]
        return super().on_drive(drive)

    def on_write(self, number: int, value: float) -> list[Message]:
        self.values[number] = value
        return [RegisterValue(number, value)]

    def each_tick(self) -> None:
        if getattr(self, "quiet", False):
            self.held, self.waiting = (0, 0), {}


class Hesitant(Board):
    """Hears only the third SAFE."""

    def on_safe(self, safe: Safe) -> list[Message]:
        if self.safes < 2:
            self.safes += 1
            return []
        return super().on_safe(safe)


class Speechless(Board):
    """Takes ARM and streams, but says no STATUS to it."""

    def on_arm(self) -> list[Message]:
        super().on_arm()
        return []


class Gibberish(Board):
    """Its SENSE contradicts itself from some tick on: `n` rows of `width` bytes a code, in the payload of one row."""

    def __init__(self, n: int, width: int, at: int) -> None:
        super().__init__()
        self.n, self.width, self.at = n, width, at

    def say_row(self, tick: int, vx: int, vy: int, ux: int, uy: int) -> bytes:
        if tick < self.at:
            return super().say_row(tick, vx, vy, ux, uy)
        payload = struct.pack("<HBBBhhhh", self.n, self.width, 0, 0, vx, vy, ux, uy)
        data, spent = SERIAL.encode(0x20, self.tx.seq, tick, payload)
        self.tx.seq = (self.tx.seq + spent) & 0xFFFF
        return data


class Still(Board):
    """Answers everything, but streams nothing from some tick on."""

    def __init__(self, at: int = 0) -> None:
        super().__init__()
        self.at = at

    def say_row(self, tick: int, vx: int, vy: int, ux: int, uy: int) -> bytes:
        return super().say_row(tick, vx, vy, ux, uy) if tick < self.at else b""


class StillAndLate(Still):
    """Falls behind the time before it streams nothing any more, and catches up."""

    def each_tick(self) -> None:
        if self.tick == self.at - 20:
            time.sleep(0.48)


class Stubborn(Board):
    """Keeps a register at a value of its own, and says so or claims the other."""

    def __init__(self, name: str, value: float, *, honest: bool) -> None:
        super().__init__()
        self._own, self._value, self._honest = _NUMBER[name], value, honest

    def on_write(self, number: int, value: float) -> list[Message]:
        if number != self._own:
            return super().on_write(number, value)
        self.values[number] = self._value
        return [RegisterValue(number, self._value if self._honest else value)]


class Miscounts(Board):
    """SESSION reads one more than was written."""

    def on_write(self, number: int, value: float) -> list[Message]:
        return super().on_write(number, value + (number == _NUMBER["SESSION"]))


class Restarts(Board):
    """Loses its supply for a moment; `lax`: and may be armed without a greeting."""

    def __init__(self, *, lax: bool, streams: bool) -> None:
        super().__init__()
        self.lax, self.streams, self.restarted = lax, streams, False

    def each_tick(self) -> None:
        if self.tick == AT and not self.restarted:
            self.restarted = True
            lockstep = self.values[_NUMBER["CLOCK_MODE"]]
            self.power_up()
            self.tick, self.greeted = -1, self.lax
            if self.streams:
                self.values[_NUMBER["CLOCK_MODE"]] = lockstep
                self.state = State.ARMED

    def on_arm(self) -> list[Message]:
        if self.lax and self.restarted and self.state is State.BOOT:
            self.state = State.IDLE
        return super().on_arm()


class CriesWatchdog(StopsItself):
    """Says that its watchdog tripped although it was fed all the time."""

    def __init__(self) -> None:
        super().__init__(SafeReason.WATCHDOG)


class Jumps(Board):
    """Its tick leaps ahead by so much."""

    def __init__(self, ticks: int = 2**31 - 1000) -> None:
        super().__init__()
        self.ticks = ticks

    def each_tick(self) -> None:
        if self.tick == AT:
            self.tick += self.ticks
            self.fed = self.tick


class ClockStands(Board):
    """Says the same time whenever it is asked."""

    def on_time(self, sync: TimeSync) -> list[Message]:
        return [sync._replace(board_ns=12345678)]


class ClockRuns(Board):
    """Its clock runs faster than time by this factor."""

    def __init__(self, factor: float) -> None:
        super().__init__()
        self.factor = factor

    def on_time(self, sync: TimeSync) -> list[Message]:
        return [sync._replace(board_ns=round(self.factor * time.monotonic_ns()))]


class SaysStatus(Board):
    """Says a STATUS that nobody may say, once, and goes on."""

    def __init__(self, state: int, reason: int) -> None:
        super().__init__()
        self.wrong = state, reason

    def each_tick(self) -> None:
        if self.tick == AT:
            status = self.say_status()[0]
            assert isinstance(status, Status)
            self._link.offer(self._frames([status._replace(state=self.wrong[0], reason=self.wrong[1])]))


class Introduces(Board):
    """Says IDENTITY although nobody asks, or twice where it is asked once."""

    def __init__(self, *, twice: bool) -> None:
        super().__init__()
        self.twice = twice

    def on_hello(self, hello: Hello) -> list[Message]:
        return super().on_hello(hello) * (2 if self.twice else 1)

    def each_tick(self) -> None:
        if self.tick == AT and not self.twice:
            self._link.offer(self._frames([self.identity]))


class Unmoved(Board):
    """Stops at SAFE, and gives a reason that cannot be."""

    def __init__(self, reason: int) -> None:
        super().__init__()
        self.why = reason

    def on_safe(self, safe: Safe) -> list[Message]:
        status = super().on_safe(safe)[0]
        assert isinstance(status, Status)
        return [status._replace(reason=self.why)]


class Echoes(Board):
    """Shows other drives than it was sent, from some tick on: what `shown` makes of them, and flags that it adds."""

    def __init__(self, shown: Callable[[int, int], tuple[int, int]], flags: int = 0) -> None:
        super().__init__()
        self.shown, self.more = shown, flags

    def say_row(self, tick: int, vx: int, vy: int, ux: int, uy: int) -> bytes:
        if tick >= AT:
            ux, uy = self.shown(ux, uy)
            self.flags |= self.more
        return super().say_row(tick, vx, vy, ux, uy)


class Answers(Board):
    """Answers ARM by the STATUS of another state, and streams; asked again, by the right one."""

    def __init__(self, state: int, reason: int) -> None:
        super().__init__()
        self.says = state, reason

    def on_arm(self) -> list[Message]:
        status = super().on_arm()[0]
        assert isinstance(status, Status)
        return [status._replace(state=self.says[0], reason=self.says[1])] if self.arms == 1 else [status]


class RefusesHello(Board):
    """NACK to HELLO."""

    def on_hello(self, hello: Hello) -> list[Message]:
        return [Nack(type_of(Hello), self._seq, NackReason.BAD_STATE)]


class Stuck(Board):
    """A sense channel says the same code all the time."""

    def __init__(self, axis: str, code: int) -> None:
        super().__init__()
        self.axis, self.code = axis, code

    def say_row(self, tick: int, vx: int, vy: int, ux: int, uy: int) -> bytes:
        vx, vy = (self.code, vy) if self.axis == "x" else (vx, self.code)
        return super().say_row(tick, vx, vy, ux, uy)


class Turned(Board):
    """Drives or sense channels are wired the wrong way round: signs of (drive x, drive y, sense x, sense y)."""

    def __init__(self, *signs: int) -> None:
        super().__init__()
        self.signs = signs

    def on_drive(self, drive: DriveForce) -> list[Message]:
        return super().on_drive(drive._replace(ux=self.signs[0] * drive.ux, uy=self.signs[1] * drive.uy))

    def say_row(self, tick: int, vx: int, vy: int, ux: int, uy: int) -> bytes:
        sx, sy = self.signs[2:]
        return super().say_row(tick, sx * vx, sy * vy, self.signs[0] * ux, self.signs[1] * uy)


class Refuses(Board):
    """Refuses ARM, always for the same reason."""

    def __init__(self, reason: int) -> None:
        super().__init__()
        self.why = reason

    def on_arm(self) -> list[Message]:
        self.arms += 1
        return [Nack(type_of(Arm), self._seq, self.why)]


@contextmanager
def served(board: Board, **identity: Any) -> Iterator[Board]:
    """A board that serves, some fields of its IDENTITY changed."""
    board.identity = board.identity._replace(**identity)
    with board:
        yield board


# ----------------------------------------------------------- what ends no run, and what STATUS alone would not show


class StaysRunning(Liar):
    """Says SAFE, stays RUNNING and says no more of it; in lockstep, where it waits, nothing of that is to be seen."""

    def each_tick(self) -> None:
        if self.safes:
            self.held, self.waiting = (0, 0), {}


class Swallows(Board):
    """Is SAFE, and says nothing to a drive that it should refuse."""

    def on_drive(self, drive: DriveForce) -> list[Message]:
        return super().on_drive(drive) if self.streaming else []


class RefusesOtherwise(Board):
    """Is SAFE, and refuses a drive there for a reason that belongs to something else."""

    def on_drive(self, drive: DriveForce) -> list[Message]:
        if self.streaming:
            return super().on_drive(drive)
        return [Nack(type_of(DriveForce), self._seq, NackReason.OUT_OF_RANGE)]


class WakesUp(Board):
    """Takes a drive in SAFE for a wish to be driven again."""

    def on_drive(self, drive: DriveForce) -> list[Message]:
        if self.streaming or not self.safes:
            return super().on_drive(drive)
        self.state, self.reason = State.RUNNING, SafeReason.NONE
        return self.say_status()


class Forgets(Board):
    """Loses what a register holds at some tick, and runs on."""

    def __init__(self, name: str, value: float = 0.0) -> None:
        super().__init__()
        self.lost = _NUMBER[name], value

    def each_tick(self) -> None:
        if self.tick == AT:
            self.values[self.lost[0]] = self.lost[1]


class Complains(Board):
    """Refuses by `nack` at every tick from some on, whatever the host said, and does it all the same."""

    def __init__(self, of_type: int, reason: int, *, sent: bool) -> None:
        super().__init__()
        self.complaint, self.sent = (of_type, reason), sent

    def each_tick(self) -> None:
        if AT <= self.tick < AT + 200:
            seq = self._seq if self.sent else (self._seq + 20_000) & 0xFFFF
            self._link.offer(self._frames([Nack(self.complaint[0], seq, self.complaint[1])]))


class Skips(Board):
    """Its tick leaves some out, and with `numbers` as many sequence numbers, as if frames had been lost."""

    def __init__(self, ticks: int, *, numbers: bool = False) -> None:
        super().__init__()
        self.ticks, self.numbers = ticks, numbers

    def each_tick(self) -> None:
        if self.tick == AT:
            self.tick += self.ticks
            self.fed = self.tick
            if self.numbers:
                self.tx.seq = (self.tx.seq + self.ticks) & 0xFFFF


class Starved(Board):
    """Says SAFE, and is then kept from its processor: its answers come, later than any while it ran."""

    def __init__(self, kept_s: float, at: Callable[[Message], bool]) -> None:
        super().__init__()
        self.kept_s, self.at = kept_s, at

    def answer(self, item: Received) -> list[Message]:
        if self.safes and self.kept_s and self.at(item.message):
            time.sleep(self.kept_s)
            self.kept_s = 0.0
        return super().answer(item)


class Mute(Board):
    """Says SAFE, stops, and answers nothing any more."""

    def answer(self, item: Received) -> list[Message]:
        gone = self.safes > 0
        answers = super().answer(item)
        return [] if gone else answers
