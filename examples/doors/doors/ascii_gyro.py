"""A sensor that writes lines, `$G,COUNTER,RATE*CHECKSUM`: a rate in m°/s, the checksum of NMEA 0183."""

import math
import re
from functools import reduce

from hil.records.layout import Column
from hil.sensors.adapter import Sample

_LINE = re.compile(rb"\$(G,(\d{1,3}),(-?\d{1,7}))\*([0-9A-F]{2})\r\n")
_LONGEST = 64


class AsciiGyro:
    """As `hil.sensors.adapter.Adapter`."""

    title = "ASCII gyro, rate"
    channels = (Column("rate_z_code", "i4", "rad/s", math.radians(1e-3)),)
    baud = 115_200
    counter_size = 256
    rates_Hz = (50.0, 100.0, 200.0)

    def __init__(self) -> None:
        self.crc_errors = 0
        self.skipped = 0
        self._rest = b""

    def feed(self, data: bytes) -> list[Sample]:
        """The lines that these bytes complete."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-_LONGEST:]
        return [sample for line in lines if (sample := self._sample(line + b"\n")) is not None]

    def complaints(self, status: int) -> list[str]:
        """It has no status."""
        return []

    def _sample(self, line: bytes) -> Sample | None:
        found = _LINE.fullmatch(line)
        if found is None or int(found[4], 16) != _checksum(found[1]) or int(found[2]) > 255:
            self.crc_errors += line.startswith(b"$G")
            self.skipped += len(line)
            return None
        return Sample(int(found[2]), (int(found[3]),), 0, 0)


def _checksum(body: bytes) -> int:
    return reduce(lambda found, byte: found ^ byte, body)
