"""One decoder for every declared protocol of a serial line: bytes in, samples out.

After a frame the next one is expected at once. What stands there instead is counted: a wrong checksum as such, other
bytes as skipped; the beginning of a frame is then looked for until a checksum fits again.
"""

import math
import re

from hil.records.layout import Column
from hil.sensors.adapter import Sample
from hil.sensors.declared import Protocol
from hil.sensors.layouts import Layout, Reading, framing_of

_OWN_COUNT = 256
"""Values of the count that stands for a counter where the sensor has none."""

_CLOCK_SIZE = 1 << 32


class StreamDecoder:
    """Decoder of one stream; see `hil.sensors.adapter.Adapter`.

    Attributes:
        frames: those whose checksum fitted; understood: bytes of these.
        counter_size, counter_Hz: of a count of our own where the sensor sends neither counter nor clock: then only the
            host's clock tells of gaps, and `counts_itself` is True. Of a clock where one is sent beside the counter.
    """

    def __init__(self, protocol: Protocol) -> None:
        self.name, self.title, self.protocol = protocol.name, protocol.title, protocol
        self.baud, self.bauds, self.rates_Hz = protocol.bauds[0], protocol.bauds, protocol.rates_Hz
        self.counter_size = protocol.counter_size or _OWN_COUNT
        self.counter_Hz = protocol.counter_Hz
        self.counts_itself = not protocol.counter_size
        self.crc_errors = self.skipped = self.frames = self.understood = 0
        self._framing, self._ends = framing_of(protocol), protocol.ends
        self.channels = self._framing.rates
        self._columns: dict[str, Column] = {}
        self._held: dict[str, float] = {}
        self._begin = re.compile(b"|".join(map(re.escape, self._framing.begins)))
        self._kept = max(max(map(len, self._framing.begins)) - 1, len(protocol.ends))
        self._rest = b""
        self._count = 0
        self._synchronised = self._begun = False

    def feed(self, data: bytes) -> list[Sample]:
        buffer, at, samples = self._rest + data, 0, []
        while (found_at := self._begin.search(buffer, at)) is not None:
            begin = found_at.start()
            if self._synchronised and self._ends and buffer.startswith(self._ends, at):
                at += len(self._ends)
                continue
            if begin > at:
                self._skip(buffer[at:begin])
                at = begin
            found = self._framing.find(buffer, at)
            size = found if isinstance(found, int) else 0 if found is None else found.size
            if at + size > len(buffer):
                break
            if isinstance(found, Layout) and self._framing.fits(frame := buffer[at : at + size]):
                at += size
                self._synchronised = self._begun = True
                self.frames += 1
                self.understood += size
                if (sample := self._sample(found, frame)) is not None:
                    samples.append(sample)
                continue
            self._lose(buffer[at : at + 1], in_frame=True)
            at += 1
        else:
            end = max(len(buffer) - self._kept, at)
            if end > at and not (self._ends and buffer.startswith(self._ends, at)):
                self._skip(buffer[at:end])
                at = end
        self._rest = buffer[at:]
        return samples

    def complaints(self, status: int) -> list[str]:
        return self.protocol.complaints(status)

    def _skip(self, between: bytes) -> None:
        """Bytes where no frame begins; lines of text between frames are answers to a command."""
        self._lose(between, in_frame=not between.isascii())

    def _lose(self, lost: bytes, *, in_frame: bool) -> None:
        if self._synchronised and in_frame:
            self.crc_errors += 1
            self._count += 1
        self._synchronised = False
        self.skipped += len(lost) if self._begun else 0

    def _sample(self, layout: Layout, frame: bytes) -> Sample | None:
        try:
            reading = layout.read(frame)
        except ValueError:  # a text whose columns are no numbers, or not as many as declared
            return None
        if not all(map(math.isfinite, reading.values.values())):
            return None
        for one in layout.fields:
            name = one.name.partition("@")[0]
            if name in reading.values and name not in self._columns and (column := one.column) is not None:
                self._columns[name] = column
                self.channels = tuple(self._columns.values())
        self._held |= reading.values
        rates = [name for name in self._columns if name.startswith("rate_")]
        if not self._columns or any(name not in reading.values for name in rates):
            return None  # temperatures between two samples, and the like
        return Sample(self._counted(reading), tuple(self._held[name] for name in self._columns), reading.status,
                      reading.latency_us)  # fmt: skip

    @property
    def has_rates(self) -> bool:
        return any(name.startswith("rate_") for name in self._columns)

    def _counted(self, reading: Reading) -> int:
        if reading.clock is not None:
            self.counter_size, self.counter_Hz = _CLOCK_SIZE, self.protocol.clock_Hz
            return reading.clock % _CLOCK_SIZE
        if reading.counter is not None:
            return reading.counter % self.counter_size
        self.counter_size, self.counter_Hz, self.counts_itself = _OWN_COUNT, 0.0, True
        self._count += 1
        return self._count % self.counter_size
