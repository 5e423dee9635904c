"""The firmware: states, watchdog and counters of a board. Bytes in, bytes out, no clock.

    BOOT → IDLE       HELLO of the same spec
    → ARMED           ARM; SENSE streams, force is zero
    → RUNNING         the first drive, in gain mode the first matrix
    → SAFE            SAFE, watchdog, a lost or restarted host, a fault; force is zero until ARM

docs/safety.md has the rules and the whole table. What keeps a board in SAFE is a latch, which a HELLO lifts, or its own
fault, which lasts as long as the scenario says.

In lockstep `exchange` itself goes on to the next SENSE when a drive frame answers the last one. On wall time
the server calls `block` at each deadline, and `exchange` only takes what the host says.

An interval that has begun cannot be changed: a drive is late when the one at its effective tick has begun. A
tick that is due a drive and gets none holds the last one. Both are counted. Without latency, which only
lockstep allows, the interval after the last row waits for the answer.

In gain mode the board closes the loop itself (`device_emulator.feedback`) with the matrix last heard; its server says
by `pass_time` how far wall time has come before it hands on what the host said, so that nothing acts on the past.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.device import Device
from device_emulator.drive import Schedule, drive_code_max, drive_scale
from device_emulator.feedback import Feedback, Matrix
from device_emulator.registers import Refused, Registers
from device_emulator.scenario import Scenario
from hil.wire.codec import type_of
from hil.wire.frame_format import FrameFormat
from hil.wire.messages import (
    Arm,
    Capabilities,
    ClockMode,
    DriveBoard,
    DriveForce,
    DriveGains,
    FieldRead,
    FieldValue,
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
from hil.wire.sense import Sense
from hil.wire.serial_format import SERIAL
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter

_BOARD_TYPES = frozenset(layout.type for layout in SPEC.messages.values() if layout.sender == "board")
_PASSING = SafeReason.LINK_LOST  # the one reason a host may give that does not latch
_LATCHING = (SafeReason.HOST_REQUEST, SafeReason.INTERRUPTED, SafeReason.RESIDUAL)

HORIZON = 1 << 16
"""An effective tick up to this far ahead is to come; any other, in 32 bits, has passed."""

_DRIVE_LIMIT = SPEC.registers["DRIVE_LIMIT"].id
_TICK = 0xFFFFFFFF
_HELD, _CLIPPED, _SATURATED = (int(flag) for flag in SenseFlags)  # plain integers: the flags are slow


class Board:
    """A board around a device. `clocks` are the modes its server can keep, the first in force at power-up; `form` is
    the format of its link."""

    def __init__(
        self, scenario: Scenario, device: Device, clocks: tuple[ClockMode, ...], form: FrameFormat = SERIAL
    ) -> None:
        self._device = device
        self._clocks = clocks
        self.format = form
        self._code_max = drive_code_max(scenario)
        self._width = 2 if max(scenario.sense.adc_bits, scenario.drive.dac_bits) <= 16 else 3
        self._latency = scenario.drive.latency_samples
        self._tick_ns = 1e9 / scenario.board.sample_rate_Hz
        self._pace = 1.0 + scenario.faults.clock_skew
        self._identity = _identity(scenario, clocks)
        self._rate_Hz = scenario.board.sample_rate_Hz
        tripped = scenario.faults.tripped
        self._spells = [(round(spell.start_s * self._rate_Hz), spell.duration_s * self._rate_Hz) for spell in tripped]
        self._answers: dict[type[Any], Callable[[Any], list[Message]]] = {
            Hello: self._hello,
            RegisterRead: self._read,
            RegisterWrite: self._write,
            FieldRead: self._field,
            TimeSync: self._time,
            Arm: self._arm,
            Safe: self._safe,
            DriveForce: self._drive,
            DriveGains: self._gains,
            DriveBoard: self._no_estimator,
        }
        self.power_up()

    def power_up(self) -> None:
        """Begin as after switching on: nothing remembered but what the device itself does. Its ticks go on."""
        self._schedule = Schedule()
        self._rx = Receiver(self.format, _BOARD_TYPES)
        self._tx = Transmitter(self.format)
        self.registers = Registers(self._clocks, self._rate_Hz)
        self.state = State.BOOT
        self._reason = SafeReason.NONE
        self._greeted = False  # the last HELLO matched
        self._latched = False  # a stop stands that only HELLO lifts
        self._faulty = False
        self.dropped = 0  # SENSE blocks, by whoever sends them
        self._late = self._held = self._saturated = self._trips = 0
        self._due = 0  # next tick that needs a drive, while RUNNING
        self._fed = 0  # tick at which the watchdog was last fed
        self._block: list[NDArray[np.int32]] = []  # gain mode: rows of the next SENSE
        self._block_flags = 0
        self._feedback = Feedback(self._latency, self._code_max)

    @property
    def streaming(self) -> bool:
        """Whether SENSE is due."""
        return self.state is State.RUNNING or self.state is State.ARMED

    @property
    def _limit(self) -> int:
        return min(self.registers.drive_limit, self._code_max)

    @property
    def rows(self) -> int:
        """Rows produced: the tick of the next one."""
        return self._device.tick + 1

    @property
    def missing(self) -> int:
        """Rows that the next SENSE still lacks."""
        return self.registers.block - sum(map(len, self._block))

    @property
    def tick(self) -> int:
        """Tick of the last row; 0 before the first."""
        return max(self._device.tick, 0)

    def exchange(self, data: bytes) -> bytes:
        """Take the host's bytes; return what the board says to them, in lockstep including the next SENSE."""
        if self.state is State.RUNNING and not self.registers.gain_mode:
            drive = self._rx.take_drive(data)
            if drive is not None:
                self._queue(*drive)
                return self.block() if self.registers.lockstep else b""
        said = b""
        for received in self._rx.feed(data):
            message = received.message
            answer = self._answers.get(type(message))
            repeated = isinstance(message, Arm) and self.state is State.ARMED
            try:
                if answer is None:
                    raise Refused(NackReason.NOT_SUPPORTED)
                answers = answer(message)
            except Refused as refusal:
                said += self._say(Nack(type_of(type(message)), received.seq, refusal.reason))
                continue
            said += b"".join(map(self._say, answers))
            closing = Arm | DriveForce | DriveGains
            if self.registers.lockstep and self.streaming and isinstance(message, closing) and not repeated:
                said += self.block()
        return said + b"".join(map(self._say, self._rx.refused))

    def block(self) -> bytes:
        """Go on by one block of ticks: its SENSE, and STATUS where one is due."""
        device, held, n = self._device, self._schedule, self.registers.block
        first = device.tick + 1
        if self.registers.gain_mode:
            first -= n - self.missing
            said = self._closed_block(first)
        elif n == 1:
            flags = self._begin(first - 1)
            ux, uy, limited = held.held
            vx, vy = device.row(ux, uy)
            flags |= device.clipped * _CLIPPED | limited * _SATURATED
            said = self._tx.encode_row(first, vx, vy, ux, uy, flags, self._width)
        else:
            codes = np.empty((n, 4), np.int32)
            flags = 0
            for row in range(n):
                flags |= self._begin(first - 1 + row)
                codes[row, 2], codes[row, 3], limited = held.held
                flags |= limited * _SATURATED
            codes[:, :2] = device.rows(codes[:, 2:])
            flags |= device.clipped * _CLIPPED
            said = self._tx.encode(Sense(codes, self._width, flags), first)
        every = self.registers.status_every
        if not self.streaming or (every and (first + n - 1) // every > (first - 1) // every):
            said += self._say(self.status())
        return said

    def pass_time(self, tick: int) -> bytes:
        """In gain mode, go on to `tick` where that lies within the next SENSE; returns it if the watchdog ends it."""
        rows = min(tick - self._device.tick, self.missing - 1)
        if not (self.registers.gain_mode and self.streaming) or rows <= 0:
            return b""
        self._close_loop(rows)
        return b"" if self.streaming else self.block()

    def _closed_block(self, first: int) -> bytes:
        self._close_loop(self.missing)
        codes = np.concatenate(self._block)
        sense = Sense(codes, self._width, self._block_flags, self._feedback.matrix_id)
        self._forget_block()
        return self._tx.encode(sense, first)

    def _close_loop(self, rows: int) -> None:
        """Produce rows with the loop closed on this board, up to where a matrix is switched or the watchdog trips."""
        device, feedback = self._device, self._feedback
        feedback.obey(self.registers)
        while rows:
            if self._spells:
                self._protect(self.tick)
            n = min(rows, feedback.switch(device.tick + 1) - device.tick - 1, self._until_fault())
            if self.state is State.RUNNING:
                left = self._fed + self.registers.watchdog - device.tick
                if left <= 0:
                    self._trips += 1
                    self.enter_safe(SafeReason.WATCHDOG)
                else:
                    n = min(n, left)
            limited = int(feedback.record["limited"][0])
            self._block.append(device.closed_rows(feedback.record, n))
            limited = int(feedback.record["limited"][0]) - limited
            self._saturated += limited
            self._block_flags |= device.clipped * _CLIPPED | (limited > 0) * _SATURATED
            rows -= n

    def _forget_block(self) -> None:
        self._block, self._block_flags = [], 0

    def _begin(self, tick: int) -> int:
        """Settle which drive is held over the interval that starts at `tick`; returns flags for its row."""
        if self._spells and self.streaming:
            self._protect(tick)
        came = self._schedule.take(tick)
        if self.state is not State.RUNNING:
            return 0
        if tick - self._fed >= self.registers.watchdog:
            self._trips += 1
            self.enter_safe(SafeReason.WATCHDOG)
            return 0
        if tick != self._due:
            return 0
        self._due += self.registers.block
        if came:
            return 0
        self._held += 1
        return _HELD

    def coast(self, ticks: int) -> bytes:
        """Let the mass swing for some ticks under zero force, unwatched; returns STATUS if a fault came meanwhile."""
        self._device.rows(np.zeros((ticks, 2), np.int32))
        tripped = bool(self._spells) and self._protect(self.tick)
        return self._say(self.status()) if tripped else b""

    def prepare(self) -> None:
        """Do between ticks what can be done before the next one."""
        self._device.prepare()

    def enter_safe(self, reason: SafeReason) -> None:
        """Zero force from the present interval on."""
        self.state, self._reason = State.SAFE, reason
        self._schedule.clear()
        self._feedback.open()

    def hang_up(self) -> None:
        """The host is gone: a board that streams goes to SAFE; others stay as they are."""
        if self.streaming:
            self.enter_safe(SafeReason.LINK_LOST)

    def fault(self, present: bool) -> bytes:
        """The board's own protection trips, or its fault is gone; returns the STATUS that tells it."""
        return self._say(self.status()) if self._trip(present) else b""

    def _trip(self, present: bool) -> bool:
        """`fault` without a word; whether it tripped."""
        tripped = present and not self._faulty
        self._faulty = present
        if tripped:
            self.enter_safe(SafeReason.FAULT)
        return tripped

    def _protect(self, tick: int) -> bool:
        """Trip, or see that the fault is gone, as the scenario says for the interval that begins at a tick; whether it
        tripped."""
        return self._trip(any(first <= tick < first + ticks for first, ticks in self._spells))

    def _until_fault(self) -> int:
        """Ticks until the next fault."""
        return min((first - self.tick for first, _ in self._spells if first > self.tick), default=1 << 62)

    def status(self) -> Status:
        """State and counters."""
        return Status(
            state=self.state,
            reason=self._reason,
            late=self._late,
            held=self._held,
            bad_frames=self._rx.bad + self._rx.passed_over,
            lost_seq=self._rx.lost,
            saturated=min(self._saturated, _TICK),
            watchdog_trips=self._trips,
            dropped=self.dropped,
            tick=self.tick & _TICK,
        )

    def close(self) -> None:
        """Finish the device's records."""
        self._device.close()

    def _say(self, message: Message) -> bytes:
        return self._tx.encode(message, self.tick)

    def _queue(self, ux: int, uy: int, effective_tick: int) -> int | None:
        """Queue a drive within its limits; returns its effective tick, or None if that has passed."""
        first_open = self._device.tick + (self._latency > 0)
        ahead = (effective_tick - first_open) & _TICK
        if ahead >= HORIZON:
            self._late += 1
            return None
        limit = self._limit
        limited = not (-limit <= ux <= limit and -limit <= uy <= limit)
        if limited:
            self._saturated += 1
            ux, uy = max(-limit, min(ux, limit)), max(-limit, min(uy, limit))
        self._schedule.put(first_open + ahead, ux, uy, limited)
        self._fed = self._device.tick
        return first_open + ahead

    def _gains(self, gains: DriveGains) -> list[Message]:
        if not (self.streaming and self.registers.gain_mode):
            raise Refused(NackReason.BAD_STATE)
        if gains.matrix_id == 0 or not np.all(np.abs((*gains.gain, *gains.bias)) <= SPEC.gains_limit):
            raise Refused(NackReason.OUT_OF_RANGE)
        following = self._device.tick + 1
        ahead = (gains.effective_tick - following) & _TICK
        if ahead >= HORIZON:
            self._late += 1
            ahead = 0
        self._feedback.put(Matrix(gains.matrix_id, gains.gain, gains.bias, following + ahead))
        self._fed = self._device.tick
        if self.state is State.RUNNING:
            return []
        self.state = State.RUNNING
        return [self.status()]

    def _drive(self, drive: DriveForce) -> list[Message]:
        if not self.streaming or self.registers.gain_mode:
            raise Refused(NackReason.BAD_STATE)
        effective_tick = self._queue(*drive)
        if effective_tick is None or self.state is State.RUNNING:
            return []
        self.state, self._due = State.RUNNING, effective_tick
        return [self.status()]

    def _no_estimator(self, _: DriveBoard) -> list[Message]:
        raise Refused(NackReason.BAD_STATE)  # this board's loop is never in that mode

    def _hello(self, hello: Hello) -> list[Message]:
        self._greeted = hello.protocol == SPEC.protocol and hello.spec_hash == SPEC.hash
        if self._greeted:
            self._latched = False
        if self.streaming:  # a host that begins anew has forgotten what it was driving
            self.enter_safe(SafeReason.LINK_LOST)
        elif self._greeted and self.state is State.BOOT:
            self.state = State.IDLE
        return [self._identity]

    def _arm(self, _: Arm) -> list[Message]:
        if self.state is State.ARMED:  # the answer to the first one was lost on the way
            return [self.status()]
        if self.state not in (State.IDLE, State.SAFE) or not self._greeted:
            raise Refused(NackReason.BAD_STATE)
        if self._latched or self._faulty:
            raise Refused(NackReason.LATCHED)
        if self._latency == 0 and not (self.registers.lockstep or self.registers.gain_mode):
            raise Refused(NackReason.NOT_SUPPORTED)
        if self.registers.gain_mode and self.registers.filter_radius > SPEC.filter_radius:
            raise Refused(NackReason.OUT_OF_RANGE)
        self.state, self._reason = State.ARMED, SafeReason.NONE
        self._schedule.clear()
        self._feedback.start(self.registers)
        self._forget_block()
        return [self.status()]

    def _safe(self, safe: Safe) -> list[Message]:
        reason = SafeReason(safe.reason) if safe.reason in (_PASSING, *_LATCHING) else SafeReason.HOST_REQUEST
        latches = reason is not _PASSING
        free = not (self._latched or self._faulty)
        if self.state is not State.SAFE or (latches and free):  # or else what keeps it there stays the reason
            self.enter_safe(reason)
        self._latched = self._latched or latches
        return [self.status()]

    def _read(self, request: RegisterRead) -> list[Message]:
        return [RegisterValue(request.register, self.registers.read(request.register))]

    def _write(self, request: RegisterWrite) -> list[Message]:
        settled = self.state in (State.IDLE, State.SAFE)
        value = self.registers.write(*request, settled=settled)
        if request.register == _DRIVE_LIMIT:
            self._schedule.limit(self._limit)
            self._feedback.limit(self._limit)
        return [RegisterValue(request.register, value)]

    def _field(self, request: FieldRead) -> list[Message]:
        if request.line >= len(SPEC.table):
            raise Refused(NackReason.OUT_OF_RANGE)
        return [FieldValue(request.line, len(SPEC.table), SPEC.table[request.line].text)]

    def _time(self, sync: TimeSync) -> list[Message]:
        # In lockstep the board's time is bench time, so that a record does not depend on the machine's speed.
        now = round(self.tick * self._tick_ns) if self.registers.lockstep else round(time.monotonic_ns() * self._pace)
        return [sync._replace(board_ns=now)]


def _identity(scenario: Scenario, clocks: tuple[ClockMode, ...]) -> Identity:
    capabilities = Capabilities.FORCE_MODE | Capabilities.GAIN_MODE
    if ClockMode.LOCKSTEP in clocks:
        capabilities |= Capabilities.LOCKSTEP
    if ClockMode.PACED in clocks:
        capabilities |= Capabilities.PACED
    return Identity(
        protocol=SPEC.protocol,
        spec_hash=SPEC.hash,
        unique_id=scenario.board.unique_id,
        firmware=scenario.board.firmware,
        tick_rate_Hz=scenario.board.sample_rate_Hz,
        axes=2,
        sense_bits=scenario.sense.adc_bits,
        drive_bits=scenario.drive.dac_bits,
        sense_scale_V=2.0 * scenario.sense.adc_full_scale_V / 2**scenario.sense.adc_bits,
        drive_scale_mps2=drive_scale(scenario),
        latency_ticks=scenario.drive.latency_samples,
        capabilities=capabilities,
    )
