"""One decoder for every declared protocol of a serial line: bytes in, samples out.

After a frame the next one is expected at once. What stands there instead is counted: a wrong checksum as such, other
bytes as skipped; the beginning of a frame is then looked for until a checksum fits again.
"""

import math
import re
from bisect import bisect_left

import numpy as np
import numpy.typing as npt

from hil.records.layout import Column
from hil.sensors.adapter import Sample
from hil.sensors.declared import Protocol
from hil.sensors.layouts import CHECKS, Framing, Layout, Reading, fitting, framing_of, parts_of

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
        self._sieve = Sieve(protocol, self._framing)
        self._kept = max(max(map(len, self._framing.begins)) - 1, len(protocol.ends))
        self._rest = b""
        self._count = 0
        self._synchronised = self._begun = False

    def feed(self, data: bytes) -> list[Sample]:
        """As `Adapter.feed`."""
        buffer, at, samples = self._rest + data, 0, []
        places = Places(self._sieve, buffer)
        while (begin := places.after(at, sought=not self._synchronised)) is not None:
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
        """As `Adapter.complaints`."""
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
        """Whether what was heard has an angular rate."""
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


MANY = 1 << 15
"""Bytes from which on it pays to try all places at once."""


class Sieve:
    """Of one protocol; what was worked out for a length of frame is kept."""

    def __init__(self, protocol: Protocol, framing: Framing) -> None:
        self.begin = re.compile(b"|".join(re.escape(one) for one in framing.begins), re.DOTALL)
        self._protocol = protocol
        self._sizes = {begin: size - len(protocol.tail) for begin, size in framing.sizes.items()}
        self._parts: dict[int, tuple[int, npt.NDArray[np.uint32]]] = {}  # by the length that the checksum covers

    def possible(self, buffer: bytes) -> list[int]:
        """Places, rising, of all frames whose checksum fits, and of what is not whole yet or tells its length later."""
        if not self._sizes:
            return [found.start() for found in self.begin.finditer(buffer)]
        octets, kept = np.frombuffer(buffer, np.uint8), []
        check, before = CHECKS[self._protocol.check], self._protocol.check_from
        for begin, size in self._sizes.items():
            starts = np.flatnonzero(octets == begin[0])
            for place, byte in enumerate(begin[1:], 1):
                starts = starts[starts < octets.size - place]
                starts = starts[octets[starts + place] == byte]
            whole = np.searchsorted(starts, octets.size - size, "right")
            covered = size - before
            if covered not in self._parts:
                self._parts[covered] = parts_of(check, covered)
            kept += [fitting(check, self._parts[covered], octets, starts[:whole] + before) - before, starts[whole:]]
        places: list[int] = np.sort(np.concatenate(kept)).tolist()
        return places


class Places:
    """The places of one buffer."""

    def __init__(self, sieve: Sieve, buffer: bytes) -> None:
        self._sieve, self._buffer = sieve, buffer
        self._possible: list[int] | None = None

    def after(self, at: int, *, sought: bool) -> int | None:
        """The next from `at` on where a frame may begin; of what is `sought` in many bytes those are left out whose
        checksum does not fit."""
        if sought and self._possible is None and len(self._buffer) - at >= MANY:
            self._possible = self._sieve.possible(self._buffer)
        if not sought or self._possible is None:
            found = self._sieve.begin.search(self._buffer, at)
            return None if found is None else found.start()
        place = bisect_left(self._possible, at)
        return self._possible[place] if place < len(self._possible) else None
