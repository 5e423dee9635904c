"""SENSE: blocks of sampled codes."""

import struct
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.wire.errors import ProtocolError
from hil.wire.spec import SPEC

Codes = npt.NDArray[np.int32]

SenseRow = tuple[int, int, int, int, int, int]
"""One sample as plain integers: tick (64 bits), vx, vy, ux, uy codes, flags."""

_LAYOUT = SPEC.messages["SENSE"]
COLUMNS = tuple(field.name for field in _LAYOUT.rows)
"""Order of the codes in a row: vx, vy, ux, uy."""

_BLOCK = struct.Struct(_LAYOUT.struct)
_LIMIT = {2: 1 << 15, 3: 1 << 23}

MAX_ROWS = {width: (SPEC.max_payload - _BLOCK.size) // (len(COLUMNS) * width) for width in _LIMIT}
"""Rows that fit into one payload, by code width in bytes."""


class Sense(NamedTuple):
    """A block of samples.

    `codes` is (n, 4) int32: vx, vy, ux, uy. Row m: voltage codes sampled at tick m; drive codes, after
    quantisation and saturation, held over the interval that ends at m. `width` is bytes per code on the wire
    (2 or 3), `flags` are `SenseFlags` of the block. `matrix_id` names the gain mode's matrix the drive was computed
    with at the last row, 0 for none. The tick of the first row travels in the frame's header.
    """

    codes: Codes
    width: int
    flags: int
    matrix_id: int = 0


def encode_sense(sense: Sense) -> bytes:
    """Payload of a block.

    Raises:
        ProtocolError: width is not 2 or 3, the shape is not (n, 4), there are no or too many rows, or a code
            does not fit.
    """
    codes, width, flags, matrix_id = sense
    limit = _LIMIT.get(width)
    if limit is None:
        raise ProtocolError(f"SENSE.width: {width} bytes per code; expected 2 or 3")
    if codes.ndim != 2 or codes.shape[1] != len(COLUMNS) or not 1 <= len(codes) <= MAX_ROWS[width]:
        raise ProtocolError(
            f"SENSE: codes of shape {codes.shape}; expected (n, {len(COLUMNS)}), 1 ≤ n ≤ {MAX_ROWS[width]}"
        )
    if codes.min() < -limit or codes.max() >= limit:
        raise ProtocolError(f"SENSE: a code does not fit into {width} bytes; saturate before sending")
    count = len(codes)
    if width == 2:
        return _BLOCK.pack(count, width, flags, matrix_id) + codes.astype("<i2").tobytes()
    padded = np.ascontiguousarray(codes, dtype="<i4").view(np.uint8).reshape(count, len(COLUMNS), 4)
    return _BLOCK.pack(count, width, flags, matrix_id) + padded[:, :, :3].tobytes()


def decode_sense(payload: bytes) -> Sense:
    """Block of a payload.

    Raises:
        ProtocolError: the length does not follow from n and width, or these are out of range.
    """
    if len(payload) < _BLOCK.size:
        raise ProtocolError(f"SENSE: payload of {len(payload)} bytes; expected at least {_BLOCK.size}")
    count, width, flags, matrix_id = _BLOCK.unpack_from(payload)
    expected = _BLOCK.size + count * width * len(COLUMNS)
    if width not in _LIMIT or count < 1 or len(payload) != expected:
        raise ProtocolError(f"SENSE: n = {count}, width = {width} in a payload of {len(payload)} bytes")
    if width == 2:
        codes = np.frombuffer(payload, "<i2", offset=_BLOCK.size).astype(np.int32)
        return Sense(codes.reshape(count, len(COLUMNS)), width, flags, matrix_id)
    # The three bytes become the upper three of a 32-bit word; the arithmetic shift then brings the sign
    # along.
    words = np.zeros((count * len(COLUMNS), 4), np.uint8)
    words[:, 1:] = np.frombuffer(payload, np.uint8, offset=_BLOCK.size).reshape(-1, 3)
    codes = (words.view("<i4")[:, 0] >> 8).astype(np.int32, copy=False)
    return Sense(codes.reshape(count, len(COLUMNS)), width, flags, matrix_id)
