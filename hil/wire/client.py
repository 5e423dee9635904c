"""What a host asks a board: who it is, its registers, its field table; to arm and to be safe.

Each call sends one request and waits for its answer; what else arrives meanwhile is kept for the caller's
next `poll` or `receive_rows`. A request that stays unanswered is sent again a few times. A refusal (NACK) is a
ProtocolError, silence a LinkError.
"""

import math
import struct
import time
from collections.abc import Callable
from typing import TypeVar

from hil.wire.codec import type_of, unpack
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed, LinkError, ProtocolError
from hil.wire.frame_format import Frame
from hil.wire.messages import (
    Arm,
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
    State,
    Status,
)
from hil.wire.spec import SPEC, FieldEntry, first_difference

HELLO_EVERY_S = 0.25
"""A board may still be starting when its port opens: HELLO is repeated."""

MOST_LINES, FIELD_TABLE_S = 1024, 10.0
"""Lines that a field table may have, and the time to read them in: a board that says more would be read for minutes."""

REQUESTS = 8
"""How often a request is sent before silence is taken for an answer: lines lose frames, and asking twice does no
harm, because every request says what is to be, not what is to change."""

CHANGES = "docs/reference/wire-changes.md"
"""The page on what changed with each protocol number."""

_IDENTITY_START = struct.Struct("<HI")  # protocol, spec hash: the part of IDENTITY that never changes
_NACK_SIZE = SPEC.messages["NACK"].size
_LIVING = (State.ARMED, State.RUNNING)

_Answer = TypeVar("_Answer", bound=Message)


class Refused(ProtocolError):
    """The board answered NACK; `reason` is a `NackReason`, or a number that is none."""

    def __init__(self, message: str, reason: int) -> None:
        super().__init__(message)
        self.reason = reason


def connect(endpoint: Endpoint, timeout_s: float = 2.0) -> Identity:
    """Say HELLO and check that both ends hold the same spec. Anything unread is dropped.

    Raises:
        LinkError: no answer in time.
        Refused: NACK and nothing else in time, which the page does not know.
        ProtocolError: another protocol version, or another spec; the message names both and the first difference.
    """
    endpoint.restart()
    deadline = time.monotonic() + timeout_s
    refused: int | None = None
    while True:
        endpoint.send(Hello(SPEC.protocol, SPEC.hash))
        answer = _await_identity(endpoint, min(time.monotonic() + HELLO_EVERY_S, deadline))
        if isinstance(answer, bytes):
            payload = answer
            break
        refused = refused if answer is None else answer
        if time.monotonic() >= deadline or endpoint.link.fileno() is None:
            if refused is not None:
                told = f"{endpoint.link.name}: the board refused HELLO: {nack_name(refused)}"
                raise Refused(f"{told}; a board answers it in every state, correct the firmware", refused)
            raise LinkError(f"{endpoint.link.name}: no answer to HELLO; {endpoint.link.advice}")
    if len(payload) < _IDENTITY_START.size:
        raise ProtocolError(f"{endpoint.link.name}: IDENTITY of {len(payload)} bytes; is it a gyro board?")
    protocol, spec_hash = _IDENTITY_START.unpack_from(payload)
    if (protocol, spec_hash) != (SPEC.protocol, SPEC.hash):
        raise ProtocolError(_mismatch(endpoint, protocol, spec_hash, timeout_s))
    identity = unpack(type_of(Identity), payload)
    assert isinstance(identity, Identity)
    return identity


def _mismatch(endpoint: Endpoint, protocol: int, spec_hash: int, timeout_s: float) -> str:
    """What differs between the specs of the two ends, one line: both numbers, both hashes, the first line that
    differs where the board's table can be read."""
    hashes = f"spec hash {spec_hash:#010x} on the board, {SPEC.hash:#010x} here"
    told, remedy = f"{endpoint.link.name}: {hashes}: ", "build both from one spec.toml"
    if protocol != SPEC.protocol:
        told = f"{endpoint.link.name}: the board speaks protocol {protocol}, this host {SPEC.protocol}; {hashes}: "
        remedy = f"update the {'host' if protocol > SPEC.protocol else 'firmware'} ({CHANGES})"
    try:
        difference = first_difference(read_field_table(endpoint, timeout_s), SPEC.table)
    except LinkClosed:
        raise
    except Refused as refusal:
        told += f"the board refuses FIELD_READ ({nack_name(refusal.reason)}), so that its fields are not known"
    except (LinkError, ProtocolError) as error:
        told += f"its fields are not known, {str(error).removeprefix(f'{endpoint.link.name}: ')}"
    else:
        told += f"the field tables differ, {difference}" if difference else "yet the field tables agree"
    return f"{told}; {remedy}"


def read_field_table(endpoint: Endpoint, timeout_s: float = 2.0) -> tuple[FieldEntry, ...]:
    """The board's field table, line by line. Raises as `request`; ProtocolError for a table of more than `MOST_LINES`
    lines, or one that takes longer than `FIELD_TABLE_S`."""
    table: list[FieldEntry] = []
    lines = 1
    deadline = time.monotonic() + FIELD_TABLE_S
    while len(table) < lines:
        if (left_s := deadline - time.monotonic()) <= 0.0:
            raise ProtocolError(
                f"{endpoint.link.name}: {len(table)} of {lines} lines of the board's field table came within "
                f"{FIELD_TABLE_S:g} s; build both from one spec.toml"
            )
        answer = _read_line(endpoint, len(table), min(timeout_s, left_s))
        table.append(FieldEntry.parse(answer.entry))
        lines = answer.lines
        if lines > MOST_LINES:
            raise ProtocolError(
                f"{endpoint.link.name}: the board says that its field table has {lines} lines, which is more than "
                f"{MOST_LINES}; correct the firmware, and build both from one spec.toml"
            )
    return tuple(table)


def read_register(endpoint: Endpoint, name: str, timeout_s: float = 2.0) -> float:
    """Value of a register, by its name in the spec. Raises as `request`; ProtocolError for an unknown
    name."""
    return _register(endpoint, RegisterRead(_register_id(name)), timeout_s, name)


def write_register(endpoint: Endpoint, name: str, value: float, timeout_s: float = 2.0) -> float:
    """Set a register, by its name in the spec; returns the value now in force. Raises as `read_register`."""
    return _register(endpoint, RegisterWrite(_register_id(name), value), timeout_s, f"{name} = {value:g}")


def _register(endpoint: Endpoint, message: RegisterRead | RegisterWrite, timeout_s: float, what: str) -> float:
    number = message.register
    return request(endpoint, message, RegisterValue, timeout_s, lambda answer: answer.register == number, what).value


def arm(endpoint: Endpoint, timeout_s: float = 2.0) -> Status:
    """Arm the board: SENSE streams from now on. Raises as `request`, ProtocolError also where STATUS says otherwise."""
    status = request(endpoint, Arm(), Status, timeout_s)
    if status.state not in _LIVING:
        state = next((member.name for member in State if member == status.state), f"state {status.state}")
        why = next((member.name for member in SafeReason if member == status.reason), f"reason {status.reason}")
        raise ProtocolError(f"{endpoint.link.name}: the board answered ARM by STATUS: it is in {state}, {why}")
    return status


def make_safe(endpoint: Endpoint, reason: int, timeout_s: float = 2.0) -> Status:
    """Bring the board to SAFE; `reason` is a `SafeReason`. Raises as `request`."""
    return request(endpoint, Safe(reason), Status, timeout_s, lambda status: status.state == State.SAFE)


def request(
    endpoint: Endpoint,
    message: Message,
    answer: type[_Answer],
    timeout_s: float = 2.0,
    accept: Callable[[_Answer], bool] = lambda _: True,
    what: str = "",
) -> _Answer:
    """Send a message and wait for the answer of the given type that `accept` takes.

    `what` tells in errors what the request was about.

    Raises:
        LinkClosed: the board hung up.
        LinkError: no such answer within `timeout_s` seconds.
        Refused: the board answered NACK, a ProtocolError.
    """
    name = SPEC.message_name(type_of(message)) + (f" {what}" if what else "")
    deadline = time.monotonic() + timeout_s
    again = -math.inf
    sent: list[int] = []
    while True:
        if time.monotonic() >= again:
            sent.append(endpoint.tx.seq)
            endpoint.send(message)
            again = time.monotonic() + timeout_s / REQUESTS
        items = endpoint.poll_new(max(min(deadline, again) - time.monotonic(), 0.0))
        for k, item in enumerate(items):
            found = item.message
            if isinstance(found, Nack) and found.of_seq in sent and found.of_type == type_of(message):
                endpoint.keep(items[:k] + items[k + 1 :])
                refused = f"{endpoint.link.name}: the board refused {name}: {nack_name(found.reason)}"
                raise Refused(refused, found.reason)
            if isinstance(found, answer) and accept(found):
                endpoint.keep(items[:k] + items[k + 1 :])
                return found
        endpoint.keep(items)
        if time.monotonic() >= deadline or (not items and endpoint.link.fileno() is None):
            raise LinkError(f"{endpoint.link.name}: no answer to {name} within {timeout_s:g} s; is the board still on?")


def _await_identity(endpoint: Endpoint, deadline: float) -> bytes | int | None:
    """Payload of the next IDENTITY, however long it is; when the time is up the reason of a NACK to HELLO, or None."""
    refused: int | None = None
    while True:
        frames: list[Frame] = endpoint.poll_frames(max(deadline - time.monotonic(), 0.0))
        for frame in frames:
            if frame.type == type_of(Identity):
                return frame.payload
            if frame.type == type_of(Nack) and len(frame.payload) == _NACK_SIZE:
                nack = unpack(frame.type, frame.payload)
                assert isinstance(nack, Nack)
                refused = nack.reason if nack.of_type == type_of(Hello) else refused
        if time.monotonic() >= deadline or (not frames and endpoint.link.fileno() is None):
            return refused


def _read_line(endpoint: Endpoint, line: int, timeout_s: float) -> FieldValue:
    return request(endpoint, FieldRead(line), FieldValue, timeout_s, lambda value: value.line == line)


def _register_id(name: str) -> int:
    register = SPEC.registers.get(name)
    if register is None:
        raise ProtocolError(f"register {name!r}: unknown; known are {', '.join(SPEC.registers)}")
    return register.id


def nack_name(number: int) -> str:
    """A reason of NACK by its name in the spec."""
    return next((member.name for member in NackReason if member == number), f"reason {number}")
