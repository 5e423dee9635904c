"""Frames on a byte stream: `00 | COBS(header, payload, CRC-32C) | 00`.

COBS (Cheshire and Baker, 1999) removes the zeros, so a zero byte is always a frame boundary and a receiver
that lost its place finds it again at the next one. CRC-32C (Castagnoli) covers header and payload; its
residue is constant, so a frame is checked in one call over everything received, checksum included.
"""

import struct
from types import BuiltinFunctionType

from cobs.cobs import DecodeError
from cobs.cobs import decode as cobs_decode
from cobs.cobs import encode as cobs_encode
from crc32c import crc32c

from hil.wire.errors import ProtocolError
from hil.wire.frame_format import Frame
from hil.wire.spec import SPEC

HEADER = struct.Struct("<" + "".join(field.struct for field in SPEC.frame))
"""Type, sequence number, tick."""

CRC_SIZE = 4
MIN_BODY = HEADER.size + CRC_SIZE
MAX_BODY = MIN_BODY + SPEC.max_payload
MAX_ENCODED = MAX_BODY + MAX_BODY // 254 + 1
"""Longest run of bytes between two delimiters that can still be a frame."""

_RESIDUE = 0x48674BC7  # CRC-32C of any message followed by its own little-endian CRC-32C


COBS_IN_C = isinstance(cobs_encode, BuiltinFunctionType)
"""Whether the installed `cobs` has its C part (0.1 µs a frame). That is built where a C compiler and Python's
headers are; elsewhere its Python part does the same in 2–4 µs."""


def seal(body: bytes) -> bytes:
    """Header and payload in, bytes for the wire out: checksum appended, stuffed, delimited."""
    stuffed: bytes = cobs_encode(body + crc32c(body).to_bytes(CRC_SIZE, "little"))
    return b"\0" + stuffed + b"\0"


def encode_frame(type_: int, seq: int, tick: int, payload: bytes) -> bytes:
    """One frame for the wire; `seq` and `tick` are taken modulo their width.

    Raises:
        ProtocolError: the payload is longer than the spec allows.
    """
    if len(payload) > SPEC.max_payload:
        raise ProtocolError(
            f"{SPEC.message_name(type_)}: {len(payload)} bytes; a payload has at most {SPEC.max_payload}"
        )
    return seal(HEADER.pack(type_, seq & 0xFFFF, tick & 0xFFFFFFFF) + payload)


class Decoder:
    """Takes any byte stream apart into frames.

    Never raises on what it reads, holds at most one frame's worth of bytes, and counts what it drops. How the
    stream is cut into chunks changes neither frames nor counters.

    Attributes:
        bytes: bytes seen.
        frames: intact frames.
        cobs_errors: runs between delimiters that are not COBS.
        short: runs that decode to less than a header and a checksum.
        crc_errors: runs whose checksum is wrong.
        oversize: runs longer than any frame; everything up to the next delimiter is dropped.
        dropped_bytes: bytes of all the dropped runs, delimiters not counted.
        rest: bytes held back for want of a delimiter.
        skipping: whether everything up to the next delimiter is to be dropped.
    """

    def __init__(self) -> None:
        self.rest = b""
        self.skipping = False
        self.bytes = 0
        self.frames = 0
        self.cobs_errors = 0
        self.short = 0
        self.crc_errors = 0
        self.oversize = 0
        self.dropped_bytes = 0

    @property
    def bad(self) -> int:
        """Runs dropped for any reason."""
        return self.cobs_errors + self.short + self.crc_errors + self.oversize

    def feed(self, data: bytes) -> list[Frame]:
        """The intact frames that `data` completes, in order."""
        return [Frame._make((*HEADER.unpack_from(body), body[HEADER.size : -CRC_SIZE])) for body in self._bodies(data)]

    def _bodies(self, data: bytes) -> list[bytes]:
        """Header, payload and checksum of every intact frame that `data` completes."""
        self.bytes += len(data)
        if self.skipping:
            dropped, delimiter, after = data.partition(b"\0")
            self.dropped_bytes += len(dropped)
            if not delimiter:
                return []
            self.skipping = False
            data = after
        *runs, rest = (self.rest + data).split(b"\0")
        bodies = [body for run in runs if run and (body := self._open(run)) is not None]
        if len(rest) > MAX_ENCODED:
            self.oversize += 1
            self.dropped_bytes += len(rest)
            self.skipping = True
            rest = b""
        self.rest = rest
        return bodies

    def _open(self, run: bytes) -> bytes | None:
        """Body of one run between delimiters, or None after counting why not."""
        if len(run) > MAX_ENCODED:
            self.oversize += 1
        else:
            try:
                body: bytes = cobs_decode(run)
            except DecodeError:
                self.cobs_errors += 1
            else:
                if len(body) < MIN_BODY:
                    self.short += 1
                elif crc32c(body) != _RESIDUE:
                    self.crc_errors += 1
                elif len(body) > MAX_BODY:
                    self.oversize += 1
                else:
                    self.frames += 1
                    return body
        self.dropped_bytes += len(run)
        return None
