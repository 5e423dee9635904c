"""The two checksums of a block: one over its head, which says what the body is, one over its body.

A block is one message of the Arrow stream: eight bytes (marker, length of the head), the head with its note, the body.
The note is JSON of a fixed length and begins with both checksums, CRC-32C in eight hexadecimal digits:

    {"head": "5f0c1a2b", "body": "90ab34cd", "block": 7, "first_row": 7168, "rows": 1024}

`body` is that of the body. `head` is that of the bytes before the body with its own digits zero, continued from the
`head` of the block before, and in the first block from the file's header: so scales, units, order and number of the
blocks are covered as well as the rows.
"""

import json
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

from crc32c import crc32c

METHOD = "CRC-32C"
MARKER = b"\xff\xff\xff\xff"
END_OF_STREAM = MARKER + bytes(4)
PREFIX = 8
"""Bytes before a head: the marker and the head's length."""

_NOTE_BYTES = 128
_OPENING = b'{"head": "'
_DIGITS = 8
_BODY_AT = len(b'00000000", "body": "')
_BODY_LENGTH_FIELD = 3  # of the Message table: version, header type, header, bodyLength


class BrokenBlockError(ValueError):
    """The bytes are no block, or not those that were written; one line says why."""


class Lengths(NamedTuple):
    """Bytes of a message: up to the end of its head, and of its body."""

    head: int
    body: int


def note_text(note: Mapping[str, Any]) -> bytes:
    """A block's note with room for its checksums."""
    text = json.dumps({"head": "0" * _DIGITS, "body": "0" * _DIGITS, **note}).ljust(_NOTE_BYTES)
    return text.encode()


def seal(message: bytearray, before: int) -> int:
    """Write both checksums into a message that was made with `note_text`; returns its `head`, for the next one."""
    lengths = lengths_of(message)
    at = _digits_at(message, lengths.head)
    body_at = at + _BODY_AT
    message[body_at : body_at + _DIGITS] = b"%08x" % crc32c(memoryview(message)[lengths.head :])
    head = crc32c(memoryview(message)[: lengths.head], before)
    message[at : at + _DIGITS] = b"%08x" % head
    return head


def checked_head(head: bytes, before: int) -> tuple[int, int]:
    """The checksums of a block (head, body), from its bytes up to the body.

    Raises BrokenBlockError when they are not the bytes that were sealed.
    """
    at = _digits_at(head, len(head))
    found = _hexadecimal(head[at : at + _DIGITS])
    if crc32c(head[:at] + b"0" * _DIGITS + head[at + _DIGITS :], before) != found:
        raise BrokenBlockError("its checksum differs")
    return found, _hexadecimal(head[at + _BODY_AT : at + _BODY_AT + _DIGITS])


def stated_head(head: bytes) -> int:
    """The `head` checksum that a block says it has, from bytes that begin with it, for the one that follows.

    Raises BrokenBlockError when it says none.
    """
    at = _digits_at(head, len(head))
    return _hexadecimal(head[at : at + _DIGITS])


def head_length(prefix: bytes) -> int:
    """Bytes up to the end of the head, from the first eight. Raises BrokenBlockError when they begin no message."""
    if prefix[:4] != MARKER:
        raise BrokenBlockError("it does not begin like a block")
    return PREFIX + int.from_bytes(prefix[4:8], "little")


def lengths_of(head: bytes | bytearray) -> Lengths:
    """Lengths of the message that begins with `head`; its body's length stands in the Message table of the head.

    Raises BrokenBlockError when there is none.
    """
    try:
        (root,) = struct.unpack_from("<I", head, PREFIX)
        table = PREFIX + root
        vtable = table - struct.unpack_from("<i", head, table)[0]
        size, _, *offsets = struct.unpack_from("<6H", head, vtable)
        at = offsets[_BODY_LENGTH_FIELD] if size > 4 + 2 * _BODY_LENGTH_FIELD else 0
        body = struct.unpack_from("<q", head, table + at)[0] if at else 0
    except struct.error:
        raise BrokenBlockError("its head cannot be read") from None
    if body < 0:
        raise BrokenBlockError("its length is negative")
    return Lengths(head_length(bytes(head[:PREFIX])), body)


def is_sealed(head: bytes) -> bool:
    return _OPENING in head


def note_span(message: bytes, head: int) -> slice:
    """Where the note stands in a message whose head, of `head` bytes, carries one."""
    begin = _digits_at(message, head) - len(_OPENING)
    return slice(begin, begin + _NOTE_BYTES)


def _digits_at(head: bytes | bytearray, end: int) -> int:
    at = head.find(_OPENING, 0, end)
    if at < 0 or at + _NOTE_BYTES > end + len(_OPENING):
        raise BrokenBlockError("it carries no checksum")
    return at + len(_OPENING)


def _hexadecimal(digits: bytes) -> int:
    try:
        value = int(digits.decode("ascii"), 16)
    except ValueError:
        value = -1
    if digits != b"%08x" % max(value, 0):  # a changed bit may make a capital letter, which is the same number
        raise BrokenBlockError("its checksum differs")
    return value
