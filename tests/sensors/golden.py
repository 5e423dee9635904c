"""Datagrams worked out by hand: the checksum by long division of polynomials over two elements, no table, no register.

A register that starts with all ones is the same as inverting the first 32 bits of the message m; then the checksum is
the remainder of m x³² by g.
"""

from functools import partial
from math import radians

from hil.sensors.declared import protocols
from hil.sensors.stream_decoder import StreamDecoder

Stim300 = partial(StreamDecoder, protocols()["stim300"])
SIZE, RATE_RAD_S = 18, radians(2.0**-14)
"""Bytes of the rate-only datagram, and one step of a rate."""

G = 0x104C11DB7


def remainder(message: bytes) -> int:
    """CRC of at least four bytes, by long division."""
    bits = 8 * len(message)
    dividend = (int.from_bytes(message, "big") ^ (0xFFFFFFFF << (bits - 32))) << 32
    for place in range(bits - 1, -1, -1):
        if dividend >> (place + 32) & 1:
            dividend ^= G << place
    return dividend


# (datagram, counter, rates in steps of 2^-14 deg/s, status, latency in µs)
GOLDEN = [
    ("90 000000 000000 000000 00 00 0000", 0, (0, 0, 0), 0, 0),
    ("90 004000 FFC000 000124 00 E1 01FA", 225, (16384, -16384, 292), 0, 506),  # 1, -1 and 0.0178 deg/s
    ("90 7FFFFF 800000 640000 51 FF FFFF", 255, (8388607, -8388608, 6553600), 0x51, 65535),  # 400 deg/s about z
]


def golden() -> list[tuple[bytes, int, tuple[int, int, int], int, int]]:
    """The datagrams with their checksums, over two zero bytes more that are not sent."""
    whole = []
    for text, *meaning in GOLDEN:
        body = bytes.fromhex(text)
        whole.append((body + remainder(body + b"\0\0").to_bytes(4, "big"), *meaning))
    return whole
