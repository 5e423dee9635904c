"""Checksums of makers' frames, each over a frame with its checksum at the end: of one, and of many at once.

Each is linear: what is left over of a frame, 0 where its checksum fits, is the exclusive or, or the sum, of what each
of its bytes adds where it stands. So what many frames leave over is looked up byte by byte, for all of them at once.
"""

import binascii
import struct
import zlib
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

_MIRROR = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


class Check(NamedTuple):
    """A checksum of so many bytes: `left` of a frame is 0 where it fits; `joined` are the parts of its bytes."""

    size: int
    left: Callable[[bytes], int]
    joined: np.ufunc = np.add


def _crc32(frame: bytes) -> int:
    """x³² + x²⁶ + … + 1 from all ones, nothing mirrored or inverted (CRC-32/MPEG-2), over zeros up to a multiple of
    four bytes that are not sent. zlib's is the same with every byte and the result mirrored and the result inverted:
    compared in its mirror it is this one, at the speed of C.
    """
    mirrored = frame.translate(_MIRROR)
    body = mirrored[:-4]
    made: int = zlib.crc32(body + bytes(-len(body) % 4))
    return made ^ 0xFFFFFFFF ^ int.from_bytes(mirrored[-4:], "little")


def _words_last(frame: bytes) -> int:
    words: tuple[int, ...] = struct.unpack(f"<{len(frame) // 2}H", frame)
    return (sum(words[:-1]) - words[-1]) & 0xFFFF


CHECKS: Mapping[str, Check] = {
    "none": Check(0, lambda _: 0),
    "crc32": Check(4, _crc32, np.bitwise_xor),
    "crc16": Check(2, lambda frame: binascii.crc_hqx(frame, 0), np.bitwise_xor),
    "sum8": Check(1, lambda frame: sum(frame) & 0xFF),
    "sum16": Check(2, lambda frame: (sum(frame[:-2]) - int.from_bytes(frame[-2:], "big")) & 0xFFFF),
    "words_zero": Check(2, lambda frame: sum(struct.unpack(f">{len(frame) // 2}H", frame)) & 0xFFFF),
    "words_last": Check(2, _words_last),
}


def parts_of(check: Check, size: int) -> tuple[int, npt.NDArray[np.uint32]]:
    """What a frame of `size` zeros leaves over, and what each value of each byte adds to it (size, 256)."""
    zero = check.left(bytes(size))
    mask, bits = (1 << 8 * check.size) - 1, np.arange(256)[:, None] >> np.arange(8) & 1
    ones = [[check.left((1 << 8 * place + bit).to_bytes(size, "little")) for bit in range(8)] for place in range(size)]
    single = np.array(ones, np.uint32).reshape(size, 8)
    single = single ^ np.uint32(zero) if check.joined is np.bitwise_xor else single - np.uint32(zero)
    return zero, check.joined.reduce(np.where(bits, single[:, None, :], np.uint32(0)), axis=2) & np.uint32(mask)


def fitting(
    check: Check, parts: tuple[int, npt.NDArray[np.uint32]], octets: npt.NDArray[np.uint8], begins: npt.NDArray[np.intp]
) -> npt.NDArray[np.intp]:
    """Those of the places `begins` (n,) of `octets` from which a frame with these `parts` fits its checksum."""
    zero, tables = parts
    left = np.full(begins.size, zero, np.uint32)
    for place, table in enumerate(tables):
        check.joined(left, table[octets[place:][begins]], out=left)
    return np.asarray(begins[left & np.uint32((1 << 8 * check.size) - 1) == 0])
