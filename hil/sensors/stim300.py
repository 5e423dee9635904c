"""Sensonor STIM300 and its relatives, rate-only datagram.

    0x90 | x y z, 24 bits each | status | counter | latency, 16 bits | CRC-32        18 bytes, most significant first

Rates are two's complement, 2⁻¹⁴ °/s a step, to ±400 °/s, saturating at ±480. A sensor set up to send increments or an
integrated angle in their place sends the same datagram, which nothing in it tells. Latency is in µs.
The checksum has the polynomial 0x04C11DB7, starts with all ones, reflects nothing and inverts nothing (known as
CRC-32/MPEG-2); it covers everything before it and two zero bytes that are not sent, which make it a multiple of four.
A sensor set up for it ends each datagram with CR LF.

The layout was taken from two public drivers, vortexntnu/stim300-driver and cookednoodle/pystim300, and compared
afterwards with the data sheet, TS1524 revision 31 of 2024: tables 5-20 to 5-23, section 5.5.7, equation 1. No sensor
has been at hand. On the counter the drivers disagree; by the data sheet (7.5.2.2.18) it counts the sensor's internal
samples, 2000 a second. Its step is learned from the stream, which is right for either.
"""

import math
import zlib

from hil.records.layout import Column
from hil.sensors.adapter import Sample

IDENTIFIER = 0x90
SIZE = 18
RATE_RAD_S = math.radians(2.0**-14)
"""One step."""

_BODY = SIZE - 4
_PADDING = bytes(-_BODY % 4)
_END_OF_LINE = b"\r\n"
_STATUS = {
    7: "system integrity error",
    6: "starting up",
    5: "outside operating conditions",
    4: "overload",
    3: "error in a channel",
}
_QUALIFIED = 0b11000  # overload and channel error say which of x, y, z
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def checksum(body: bytes) -> int:
    """CRC of a datagram's first 14 bytes.

    zlib's has the same polynomial with every byte and the result mirrored and the result inverted, so mirrored and
    inverted once more it is this one, at the speed of C.
    """
    mirrored = zlib.crc32((body + _PADDING).translate(_REVERSED)) ^ 0xFFFFFFFF
    return int(f"{mirrored:032b}"[::-1], 2)


class Stim300:
    """Decoder of the stream; see `hil.sensors.adapter.Adapter`.

    After a datagram the next one is expected at once; where its checksum is wrong that is counted, and the identifier
    is looked for byte by byte until a checksum fits again.
    """

    title = "Sensonor STIM300, rate"
    channels = tuple(Column(f"rate_{axis}_code", "i4", "rad/s", RATE_RAD_S) for axis in "xyz")
    baud = 921_600
    counter_size = 256
    rates_Hz = (125.0, 250.0, 500.0, 1000.0, 2000.0)

    def __init__(self) -> None:
        self.crc_errors = 0
        self.skipped = 0
        self._rest = b""
        self._synchronised = False  # the rest begins where a datagram should
        self._begun = False

    def feed(self, data: bytes) -> list[Sample]:
        """As `Adapter.feed`."""
        buffer = self._rest + data
        at = 0
        samples = []
        while len(buffer) - at >= SIZE:
            if buffer[at] == IDENTIFIER and checksum(buffer[at : at + _BODY]) == _number(buffer, at + _BODY, 4):
                samples.append(_sample(buffer, at))
                at += SIZE
                self._synchronised = self._begun = True
            elif self._synchronised and buffer[at : at + 2] == _END_OF_LINE:
                at += 2
            else:
                if self._synchronised:
                    self.crc_errors += 1
                self._synchronised = False
                self.skipped += self._begun
                at += 1
        self._rest = buffer[at:]
        return samples

    def complaints(self, status: int) -> list[str]:
        """As `Adapter.complaints`."""
        told = []
        for bit, words in _STATUS.items():
            if status >> bit & 1:
                axes = [axis for k, axis in enumerate("xyz") if status >> k & 1] if _QUALIFIED >> bit & 1 else []
                told.append(f"{words} ({', '.join(axes)})" if axes else words)
        return told


def _sample(buffer: bytes, at: int) -> Sample:
    codes = (_signed24(buffer, at + 1), _signed24(buffer, at + 4), _signed24(buffer, at + 7))
    return Sample(buffer[at + 11], codes, buffer[at + 10], _number(buffer, at + 12, 2))


def _number(buffer: bytes, at: int, size: int) -> int:
    return int.from_bytes(buffer[at : at + size], "big")


def _signed24(buffer: bytes, at: int) -> int:
    return int.from_bytes(buffer[at : at + 3], "big", signed=True)
