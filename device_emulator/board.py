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

In force mode the turn over samples, from a drive to the next SENSE, is one call into C (`native/board.h`), which asks
Python for what is no sample. There is one copy of each number, `_c`, which both work on. In the host's own process the
host's turn calls it without Python (`memory`).

In gain mode the board closes the loop itself (`device_emulator.feedback`) with the matrix last heard; its server says
by `pass_time` how far wall time has come before it hands on what the host said, so that nothing acts on the past.
"""

import ctypes
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator import native
from device_emulator.device import Device
from device_emulator.drive import drive_code_max, drive_scale
from device_emulator.feedback import Feedback, Matrix
from device_emulator.native import ANSWER, ASK, COMMAND, HORIZON, MOST_SAID, NONE, PASS, Ask, BoardState
from device_emulator.registers import Refused, Registers
from device_emulator.scenario import Scenario
from hil.wire.codec import type_of
from hil.wire.frame_format import FrameFormat
from hil.wire.framing import Decoder
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
    TrimOutput,
    TrimRead,
)
from hil.wire.sense import Sense
from hil.wire.serial_format import SERIAL, SerialFormat
from hil.wire.spec import SPEC
from hil.wire.stream import Received, Receiver, Transmitter

_BOARD_TYPES = frozenset(layout.type for layout in SPEC.messages.values() if layout.sender == "board")
_PASSING = SafeReason.LINK_LOST  # the one reason a host may give that does not latch
_LATCHING = (SafeReason.HOST_REQUEST, SafeReason.INTERRUPTED, SafeReason.RESIDUAL)

_DRIVE_LIMIT = SPEC.registers["DRIVE_LIMIT"].id
_TICK = 0xFFFFFFFF
_CLIPPED, _SATURATED = int(SenseFlags.CLIPPED), int(SenseFlags.SATURATED)  # plain integers: the flags are slow


def _kept(name: str) -> Any:
    """A number that stands where C has it."""
    return property(lambda self: getattr(self._state, name), lambda self, value: setattr(self._state, name, value))


class _Numbered(Transmitter):
    """A transmitter whose count stands where C has it."""

    def __init__(self, form: FrameFormat, state: BoardState) -> None:
        self._state = state
        super().__init__(form)

    seq = _kept("seq")


class _Following(Receiver):
    """A receiver that is where C is in the peer's sequence and ticks."""

    def __init__(self, form: FrameFormat, foreign: frozenset[int], state: BoardState) -> None:
        self._state = state
        super().__init__(form, foreign)

    tick = _kept("heard")
    run = _kept("run")

    @property
    def expected(self) -> int | None:
        """Sequence number of the next frame."""
        expected = self._state.expected
        return None if expected == NONE else expected

    @expected.setter
    def expected(self, number: int | None) -> None:
        self._state.expected = NONE if number is None else number


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
        self._latency = scenario.drive.latency_samples
        self._tick_ns = 1e9 / scenario.board.sample_rate_Hz
        self._pace = 1.0 + scenario.faults.clock_skew
        self._identity = _identity(scenario, clocks)
        self._trims = scenario.trim
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
        if scenario.trim:
            self._answers[TrimRead] = self._trim
        self._c = BoardState(
            stream=isinstance(form, SerialFormat),
            width=2 if max(scenario.sense.adc_bits, scenario.drive.dac_bits) <= 16 else 3,
            latency=self._latency,
            protects=bool(self._spells),
        )
        self._waiting = np.zeros(HORIZON, COMMAND)
        self._raised: BaseException | None = None
        self._point()
        self.power_up()

    def _point(self) -> None:
        """Tell the C side where things are."""
        self._ask = ASK(self._asked)
        self._to = ctypes.create_string_buffer(MOST_SAID)
        self._c.ask = ctypes.cast(self._ask, ctypes.c_void_p).value or 0
        self._c.device, self._c.waiting = self._device.address, self._waiting.ctypes.data
        self._at, self._to_at = ctypes.addressof(self._c), ctypes.addressof(self._to)

    def __getstate__(self) -> dict[str, Any]:
        """All but addresses, which mean nothing elsewhere."""
        return {name: value for name, value in self.__dict__.items() if name not in ("_ask", "_to", "_at", "_to_at")}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        self.__dict__.update(kept)
        self._point()

    @property
    def memory(self) -> tuple[int, int]:
        """For a host in the same process: as `hil.wire.inproc.Board` has it."""
        return ANSWER, self._at

    def power_up(self) -> None:
        """Begin as after switching on: nothing remembered but what the device itself does. Its ticks go on."""
        c = self._c
        passed_over = _BOARD_TYPES if self._trims else _BOARD_TYPES | {type_of(TrimRead)}
        self._rx = _Following(self.format, passed_over, c)
        self._tx = _Numbered(self.format, c)
        self.registers = Registers(self._clocks, self._rate_Hz, self._trims)
        self._obey()
        self.state = State.BOOT
        self._reason = SafeReason.NONE
        self._greeted = False  # the last HELLO matched
        self._latched = False  # a stop stands that only HELLO lifts
        self._faulty = False
        self.dropped = 0  # SENSE blocks, by the sender
        c.late = c.held = c.saturated = c.trips = c.due = c.fed = c.pending = 0
        native.forget(self._at)
        self._forget_block()
        self._feedback = Feedback(self._latency, self._code_max)
        self._zero_trims()

    @property
    def state(self) -> State:
        """What STATUS tells."""
        return State(self._c.state)

    @state.setter
    def state(self, state: State) -> None:
        self._c.state = state

    @property
    def streaming(self) -> bool:
        """Whether SENSE is due."""
        return self._c.state in (State.RUNNING, State.ARMED)

    def _obey(self) -> None:
        """Have the turn follow the registers."""
        c, registers = self._c, self.registers
        c.lockstep, c.gain_mode = registers.lockstep, registers.gain_mode
        c.block, c.watchdog, c.status_every = registers.block, registers.watchdog, registers.status_every
        c.limit = min(registers.drive_limit, self._code_max)

    @property
    def rows(self) -> int:
        """Rows produced: the tick of the next one."""
        return self._device.tick + 1

    @property
    def missing(self) -> int:
        """Rows that the next SENSE still lacks."""
        return int(self._c.block - self._c.count)

    @property
    def tick(self) -> int:
        """Tick of the last row; 0 before the first."""
        return max(self._device.tick, 0)

    def exchange(self, data: bytes) -> bytes:
        """Take the host's bytes; return what the board says to them, in lockstep including the next SENSE."""
        size = PASS if self._raised else native.answer(self._at, data, len(data), self._to_at)
        if size != PASS or self._raised:  # within a call of the host's turn, too
            return self._put(size)
        said = b""
        for received in self._heard(data):
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
        if self.registers.gain_mode:
            self._close_loop(self.missing)
            self._c.matrix = self._feedback.matrix_id
            return self._put(native.tell(self._at, self._to_at))
        return self._put(native.go_on(self._at, self._to_at))

    def _put(self, size: int) -> bytes:
        """What C has put down, so many bytes. Raises what Python raised within the call."""
        if size != PASS:
            return ctypes.string_at(self._to_at, size)
        assert self._raised is not None
        raised, self._raised = self._raised, None
        raise raised

    def _asked(self, what: int, value: int, to: int | None) -> int:
        """What C asks for; what this raises is raised again when C has returned."""
        said = b""
        try:
            match what:
                case Ask.PAGE:
                    self._device.prepare()
                case Ask.PROTECT:
                    self._protect(value)
                case Ask.STARVED:
                    self.enter_safe(SafeReason.WATCHDOG)
                case Ask.SENSE:
                    c = self._c
                    said = self._tx.encode(Sense(self._codes[: c.count], c.width, c.flags, c.matrix), value)
                case Ask.STATUS:
                    said = self._say(self.status())
        except BaseException as error:  # noqa: BLE001 - Ctrl-C as well
            self._raised = error
            return PASS
        if to is not None:
            ctypes.memmove(to, said, len(said))
        return len(said)

    @property
    def _codes(self) -> NDArray[np.int32]:
        """Rows of the next SENSE, lent."""
        return np.ctypeslib.as_array(self._c.codes)

    def _heard(self, data: bytes) -> list[Received]:
        """The messages in what the host says."""
        decoder, received = self._rx.decoder, self._rx.feed(data)
        self._c.pending = isinstance(decoder, Decoder) and bool(decoder.rest or decoder.skipping)
        return received

    def pass_time(self, tick: int) -> bytes:
        """In gain mode, go on to `tick` where that lies within the next SENSE; returns it if the watchdog ends it."""
        rows = min(tick - self._device.tick, self.missing - 1)
        if not (self.registers.gain_mode and self.streaming) or rows <= 0:
            return b""
        self._close_loop(rows)
        return b"" if self.streaming else self.block()

    def _close_loop(self, rows: int) -> None:
        """Produce rows with the loop closed on this board, up to where a matrix is switched or the watchdog trips."""
        device, feedback, c = self._device, self._feedback, self._c
        feedback.obey(self.registers)
        while rows:
            if self._spells:
                self._protect(self.tick)
            n = min(rows, feedback.switch(device.tick + 1) - device.tick - 1, self._until_fault())
            if c.state == State.RUNNING:
                left = c.fed + c.watchdog - device.tick
                if left <= 0:
                    c.trips += 1
                    self.enter_safe(SafeReason.WATCHDOG)
                else:
                    n = min(n, left)
            limited = int(feedback.record["limited"][0])
            self._codes[c.count : c.count + n] = device.closed_rows(feedback.record, n)
            limited = int(feedback.record["limited"][0]) - limited
            c.count += n
            c.saturated += limited
            c.flags |= device.clipped * _CLIPPED | (limited > 0) * _SATURATED
            rows -= n

    def _forget_block(self) -> None:
        self._c.count = self._c.flags = 0

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
        self._zero_trims()
        native.forget(self._at)
        self._feedback.open()

    def _zero_trims(self) -> None:
        """Put the trim outputs to 0; the electrodes follow."""
        self.registers.zero_trims()
        for output in self.registers.trims.values():
            self._device.trim(output, 0.0)

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
        c = self._c
        return Status(
            state=self.state,
            reason=self._reason,
            late=c.late,
            held=c.held,
            bad_frames=self._rx.bad + self._rx.passed_over,
            lost_seq=self._rx.lost,
            saturated=min(c.saturated, _TICK),
            watchdog_trips=c.trips,
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
        tick: int = native.queue(self._at, ux, uy, effective_tick)
        return None if tick == NONE else tick

    def _gains(self, gains: DriveGains) -> list[Message]:
        if not (self.streaming and self.registers.gain_mode):
            raise Refused(NackReason.BAD_STATE)
        if gains.matrix_id == 0 or not np.all(np.abs((*gains.gain, *gains.bias)) <= SPEC.gains_limit):
            raise Refused(NackReason.OUT_OF_RANGE)
        following = self._device.tick + 1
        ahead = (gains.effective_tick - following) & _TICK
        if ahead >= HORIZON:
            self._c.late += 1
            ahead = 0
        self._feedback.put(Matrix(gains.matrix_id, gains.gain, gains.bias, following + ahead))
        self._c.fed = self._device.tick
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
        self.state, self._c.due = State.RUNNING, effective_tick
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
        native.forget(self._at)
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
        output = self.registers.trims.get(request.register)
        if output is not None:
            code = self.registers.write_trim(request.register, request.value, streaming=self.streaming)
            self._device.trim(output, code * self._trims[output].scale_V)
            return [RegisterValue(request.register, code)]
        settled = self.state in (State.IDLE, State.SAFE)
        value = self.registers.write(*request, settled=settled)
        self._obey()
        if request.register == _DRIVE_LIMIT:
            native.limit(self._at)
            self._feedback.limit(self._c.limit)
        return [RegisterValue(request.register, value)]

    def _trim(self, request: TrimRead) -> list[Message]:
        outputs = len(self._trims)
        if request.output >= outputs:
            return [TrimOutput(request.output, outputs, 0, 0, 0.0, 0.0, "")]
        trim = self._trims[request.output]
        return [TrimOutput(request.output, outputs, *trim.codes, trim.scale_V, trim.settling_s, trim.name)]

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
    if scenario.trim:
        capabilities |= Capabilities.TRIM
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
