"""The smallest board that can hold a conversation: for tests of the wire only."""

import numpy as np

from hil.wire.codec import field_value, type_of
from hil.wire.messages import (
    Arm,
    DriveForce,
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
    State,
    Status,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC, FieldEntry
from hil.wire.stream import Received, Receiver, Transmitter

REGISTERS = {register.id: register for register in SPEC.registers.values()}


class SmallBoard:
    """Answers requests; once armed it sends a row per drive frame, which echoes the drive also as voltage."""

    def __init__(self, **identity: object) -> None:
        self.rx = Receiver()
        self.tx = Transmitter()
        self.identity = Identity(
            SPEC.protocol, SPEC.hash, 7, 1, 4000.0, 2, 16, 16, 1e-4, 1e-3, 0, 5
        )._replace(**identity)  # fmt: skip
        self.table: tuple[FieldEntry, ...] | None = None
        self.values = {number: float(register.default) for number, register in REGISTERS.items()}
        self.state = State.IDLE
        self.tick = 0
        self.closed = False

    def exchange(self, data: bytes) -> bytes:
        answer = b"".join(self._answer(item) for item in self.rx.feed(data))
        return answer + b"".join(self._frame(nack) for nack in self.rx.refused)

    def close(self) -> None:
        self.closed = True

    def _frame(self, message: Message) -> bytes:
        return self.tx.encode(message, self.tick)

    def _status(self) -> bytes:
        return self._frame(Status(self.state, 0, 0, 0, self.rx.bad, self.rx.lost, 0, 0, 0, self.tick))

    def _row(self, ux: int, uy: int) -> bytes:
        row = self.tx.encode(Sense(np.array([(ux, uy, ux, uy)], np.int32), 2, 0), self.tick)
        self.tick += 1
        return row

    def _answer(self, item: Received) -> bytes:
        match item.message:
            case Hello():
                return self._frame(self.identity)
            case FieldRead(line):
                if self.table is None:
                    return self._frame(field_value(line))
                entry = self.table[line].text
                return self._frame(FieldValue(line, len(self.table), entry))
            case RegisterRead(number) if number in REGISTERS:
                return self._frame(RegisterValue(number, self.values[number]))
            case RegisterWrite(number, 1.0) if number == SPEC.registers["LOOP_MODE"].id:  # it has force mode only
                return self._frame(Nack(type_of(RegisterWrite), item.seq, NackReason.NOT_SUPPORTED))
            case RegisterWrite(number, value) if number in REGISTERS and REGISTERS[number].accepts(value):
                self.values[number] = value
                return self._frame(RegisterValue(number, value))
            case RegisterWrite():
                return self._frame(Nack(0x43, item.seq, NackReason.OUT_OF_RANGE))
            case Arm():
                self.state = State.ARMED
                return self._status() + self._row(0, 0)
            case DriveForce() if self.state not in (State.ARMED, State.RUNNING):
                return self._frame(Nack(type_of(DriveForce), item.seq, NackReason.BAD_STATE))
            case DriveForce(ux, uy, _):
                return self._row(ux, uy)
            case Safe():
                self.state = State.SAFE
                return self._status()
            case _:
                return b""
