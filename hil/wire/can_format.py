"""Frames in CAN FD and classic CAN frames, the way `FrameFormat` wants them.

Between a format and its link a frame is a *record*: Linux's `struct canfd_frame`, 72 bytes, in which FDF tells CAN FD
from classic.  Layouts and identifiers come from the spec; CAN has its own checksum, so frames here have none.
"""

import struct
from bisect import bisect_left

from hil.wire.errors import ProtocolError
from hil.wire.frame_format import BOARD, HOST, UNSEQUENCED, Frame, Sender
from hil.wire.sense import COLUMNS
from hil.wire.spec import SPEC, Field

CAN = SPEC.can
RECORD_SIZE = 72
BRS, FDF = 0x01, 0x04
"""Flags of a record: bit-rate switching; a CAN FD frame."""

HEAD = struct.Struct("=IBBxx")
"""Start of a record, in the byte order of the machine: identifier, number of data bytes, flags."""

ROOM = CAN.lengths[-1] - 8
"""Bytes of payload, or of rows, in one CAN FD frame."""

_LEGAL = tuple(CAN.lengths[bisect_left(CAN.lengths, n)] for n in range(CAN.lengths[-1] + 1))


def _struct(fields: tuple[Field, ...]) -> struct.Struct:
    """Bytes of some fields; bit fields that share a byte are one number."""
    letters, filled = "<", 0
    for field in fields:
        if field.bits < 8:
            filled += field.bits
        letters += field.struct
        if filled == 8:
            letters, filled = letters + "B", 0
    return struct.Struct(letters)


def _shifts(fields: tuple[Field, ...]) -> dict[str, int]:
    """Lowest bit of every bit field in its byte."""
    shifts, filled = {}, 0
    for field in fields:
        if field.bits < 8:
            shifts[field.name] = filled
            filled = (filled + field.bits) % 8
    return shifts


_TYPE = {name: layout.type for name, layout in (*SPEC.messages.items(), *CAN.classic.items())}
_SENSE, _STATUS, _SAFE, _ARM = (_TYPE[name] for name in ("SENSE", "STATUS", "SAFE", "ARM"))
_BRIEF = _TYPE["STATUS_BRIEF"]
_PART = _struct(CAN.header)
_SAFE_BODY, _ARM_BODY, _BRIEF_BODY = (
    _struct(CAN.classic[name].fields) for name in ("SAFE", "ARM", "STATUS_BRIEF")
)  # fmt: skip
_STATUS_BODY = _struct(SPEC.messages["STATUS"].fields)
_STATUS_FIELDS = [field.name for field in SPEC.messages["STATUS"].fields]
_BRIEF_FIELDS = [_STATUS_FIELDS.index(field.name) for field in CAN.classic["STATUS_BRIEF"].fields]
_BRIEF_LIMITS = [(1 << field.bits) - 1 for field in CAN.classic["STATUS_BRIEF"].fields]

# The bit fields n, wide and flags of SENSE share a byte, `shape`.
_ROWS = _struct(CAN.sense)
_BLOCK = struct.Struct(SPEC.messages["SENSE"].struct)
_ROW_SIZE = {2: 2 * len(COLUMNS), 3: 3 * len(COLUMNS)}
_SHIFTS = _shifts(CAN.sense)
_WIDE, _FLAGS_SHIFT = 1 << _SHIFTS["wide"], _SHIFTS["flags"]
_COUNT_MASK = _WIDE - 1


class CanDecoder:
    """Takes records apart into frames, joining the parts of long messages; other traffic on the bus is passed over.

    Attributes:
        bytes: bytes seen, all traffic that reached this end.
        frames: intact frames.
        malformed: frames whose length contradicts their content.
        broken: long messages of which a part is missing.
        unfinished: type and seq of the message whose parts are being joined, None for none; `joined` are those so far.
    """

    def __init__(self, node: int, sender: Sender) -> None:
        self._types = {CAN.identifier(type_, node, sender): type_ for type_ in range(1 << 11 - CAN.type_shift)}
        del self._types[CAN.identifier(_BRIEF, node, sender)]
        self._rest = b""
        self.unfinished: tuple[int, int] | None = None
        self.joined = b""
        self.bytes = 0
        self.frames = 0
        self.malformed = 0
        self.broken = 0

    @property
    def bad(self) -> int:
        """Frames and messages dropped for any reason."""
        return self.malformed + self.broken

    def feed(self, data: bytes) -> list[Frame]:
        self.bytes += len(data)
        if self._rest:
            data = self._rest + data
        whole = len(data) // RECORD_SIZE * RECORD_SIZE
        self._rest = data[whole:]
        frames: list[Frame] = []
        for at in range(0, whole, RECORD_SIZE):
            identifier, length, flags = HEAD.unpack_from(data, at)
            type_ = self._types.get(identifier)
            if type_ is not None:
                body = data[at + HEAD.size : at + HEAD.size + length]
                frame = _open_safe(body, flags) if type_ == _SAFE else self._open(type_, body, length)
                if frame is not None:
                    self.frames += 1
                    frames.append(frame)
        return frames

    def _open(self, type_: int, data: bytes, length: int) -> Frame | None:
        """The frame in the data bytes of one CAN frame; None for a part of one, and after counting a bad one."""
        if type_ == _SENSE:
            return self._open_rows(data, length)
        if type_ == _ARM:
            if length == _ARM_BODY.size:
                seq, tick = _ARM_BODY.unpack(data)
                return Frame(type_, seq, tick, b"")
        elif length >= _PART.size:
            seq, tick, size, part = _PART.unpack_from(data)
            if size <= ROOM and _LEGAL[_PART.size + size] == length:
                return self._join(type_, seq, tick, part, data[_PART.size : _PART.size + size])
        self.malformed += 1
        return None

    def _open_rows(self, data: bytes, length: int) -> Frame | None:
        if length >= _ROWS.size:
            seq, tick, shape, matrix_id = _ROWS.unpack_from(data)
            count, width = shape & _COUNT_MASK, 3 if shape & _WIDE else 2
            end = _ROWS.size + count * _ROW_SIZE[width]
            if count and end <= CAN.lengths[-1] and _LEGAL[end] == length:
                rows = data[_ROWS.size : end]
                payload = _BLOCK.pack(count, width, shape >> _FLAGS_SHIFT, matrix_id) + rows
                return Frame(_SENSE, seq, tick, payload)
        self.malformed += 1
        return None

    def _join(self, type_: int, seq: int, tick: int, part: int, payload: bytes) -> Frame | None:
        """The whole message, once its last part is there."""
        if self.unfinished is not None:
            if self.unfinished == (type_, seq):
                if part * ROOM == len(self.joined):
                    self.joined += payload
                    return self._joined(type_, seq, tick) if len(payload) < ROOM else None
                if part * ROOM < len(self.joined) and (part > 0 or payload == self.joined[:ROOM]):  # repeated
                    return None
            self.broken += 1
            self.unfinished = None
        if part:
            return None  # the rest of a message that was counted, or whose loss the sequence shows
        if len(payload) < ROOM:
            return Frame(type_, seq, tick, payload)
        self.unfinished, self.joined = (type_, seq), payload
        return None

    def _joined(self, type_: int, seq: int, tick: int) -> Frame | None:
        self.unfinished = None
        if len(self.joined) <= SPEC.max_payload:
            return Frame(type_, seq, tick, self.joined)
        self.malformed += 1
        return None


def _open_safe(body: bytes, flags: int) -> Frame:
    """SAFE, which counts whatever it looks like: a whole frame, or one cut short after the reason."""
    if flags & FDF or len(body) not in (1, _SAFE_BODY.size):
        return Frame(_SAFE, UNSEQUENCED, 0, b"")
    if len(body) == 1:
        return Frame(_SAFE, UNSEQUENCED, 0, body)
    reason, seq, tick = _SAFE_BODY.unpack(body)
    return Frame(_SAFE, seq, tick, bytes([reason]))


class CanFormat:
    """Messages as records for one `node` of the bus, from the host's or from the board's end."""

    sealed = False

    def __init__(self, node: int, sender: Sender) -> None:
        self.node = node
        self._sender = sender

    def encode(self, type_: int, seq: int, tick: int, payload: bytes) -> tuple[bytes, int]:
        """As `FrameFormat.encode`. SENSE takes a number for every frame it needs."""
        tick &= 0xFFFFFFFF
        if type_ == _SENSE:
            return self._encode_rows(seq, tick, payload)
        if type_ == _SAFE:
            return self._record(type_, _SAFE_BODY.pack(payload[0], seq, tick), fd=False), 1
        if type_ == _ARM:
            return self._record(type_, _ARM_BODY.pack(seq, tick), fd=False), 1
        if len(payload) > SPEC.max_payload:
            raise ProtocolError(
                f"{SPEC.message_name(type_)}: {len(payload)} bytes; a payload has at most {SPEC.max_payload}"
            )
        said = b"".join(
            self._record(type_, _PART.pack(seq, tick, len(part), k) + part)
            for k, part in enumerate(payload[at : at + ROOM] for at in range(0, len(payload) + 1, ROOM))
        )
        return said + self._brief(payload) if type_ == _STATUS else said, 1

    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        whole = len(data) // RECORD_SIZE * RECORD_SIZE
        return [data[at : at + RECORD_SIZE] for at in range(0, whole, RECORD_SIZE)], data[whole:]

    def kind(self, frame: bytes) -> int | None:
        identifier, _, _ = HEAD.unpack_from(frame)
        return int(identifier) >> CAN.type_shift & 0x7F

    def decoder(self) -> CanDecoder:
        return CanDecoder(self.node, BOARD if self._sender == HOST else HOST)

    def _encode_rows(self, seq: int, tick: int, payload: bytes) -> tuple[bytes, int]:
        count, width, flags, matrix_id = _BLOCK.unpack_from(payload)
        size = _ROW_SIZE[width]
        most = ROOM // size
        form = (_WIDE if width == 3 else 0) | flags << _FLAGS_SHIFT
        records: list[bytes] = []
        for first in range(0, count, most):
            n = min(most, count - first)
            at = _BLOCK.size + first * size
            body = _ROWS.pack((seq + len(records)) & 0xFFFF, (tick + first) & 0xFFFFFFFF, n | form, matrix_id)
            records.append(self._record(_SENSE, body + payload[at : at + n * size]))
        return b"".join(records), len(records)

    def _brief(self, status: bytes) -> bytes:
        values = _STATUS_BODY.unpack(status)
        brief = (min(values[k], limit) for k, limit in zip(_BRIEF_FIELDS, _BRIEF_LIMITS, strict=True))
        return self._record(_BRIEF, _BRIEF_BODY.pack(*brief), fd=False)

    def _record(self, type_: int, body: bytes, *, fd: bool = True) -> bytes:
        identifier = CAN.identifier(type_, self.node, self._sender)
        head = HEAD.pack(identifier, _LEGAL[len(body)], BRS | FDF if fd else 0)
        return (head + body).ljust(RECORD_SIZE, b"\0")
