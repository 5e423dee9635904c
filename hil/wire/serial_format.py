"""Frames on a byte stream, the way `FrameFormat` wants them; `hil.wire.framing` does the work."""

import struct

from hil.wire.framing import CRC_SIZE, HEADER, Decoder, encode_frame, seal
from hil.wire.sense import row_body
from hil.wire.spec import SPEC

_DRIVE = SPEC.messages["DRIVE_FORCE"].type
_DRIVE_BODY = struct.Struct(HEADER.format + SPEC.messages["DRIVE_FORCE"].struct[1:])
_DRIVE_BODY_SIZE = _DRIVE_BODY.size + CRC_SIZE


class SerialDecoder(Decoder):
    """The decoder of the byte stream, with a short way for what a board hears sample by sample."""

    __slots__ = ()

    def drive(self, data: bytes, seq: int | None) -> tuple[int, int, int, int] | None:
        """As `FrameDecoder.drive`."""
        body = self.peek(data)
        if body is None or len(body) != _DRIVE_BODY_SIZE or body[0] != _DRIVE:
            return None
        _, found, tick, ux, uy, effective_tick = _DRIVE_BODY.unpack_from(body)
        if found != seq:
            return None
        self.frames += 1
        self.bytes += len(data)
        return tick, ux, uy, effective_tick


class SerialFormat:
    """COBS, CRC-32C and delimiters."""

    sealed = True

    def encode(self, type_: int, seq: int, tick: int, payload: bytes) -> tuple[bytes, int]:
        """As `FrameFormat.encode`; one frame, one number."""
        return encode_frame(type_, seq, tick, payload), 1

    def encode_row(self, seq: int, tick: int, vx: int, vy: int, ux: int, uy: int, flags: int, width: int) -> bytes:
        """As `FrameFormat.encode_row`."""
        return seal(row_body(seq, tick & 0xFFFFFFFF, vx, vy, ux, uy, flags, width))

    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        """As `FrameFormat.cut`."""
        *runs, rest = data.split(b"\0")
        return [b"\0" + run + b"\0" for run in runs if run], rest

    def kind(self, frame: bytes) -> int | None:
        """As `FrameFormat.kind`."""
        body = Decoder().peek(frame)
        return None if body is None else body[0]

    def decoder(self) -> SerialDecoder:
        """As `FrameFormat.decoder`."""
        return SerialDecoder()


SERIAL = SerialFormat()
"""The format of every link that carries bytes."""
