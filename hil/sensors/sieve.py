"""Where frames may begin in a buffer: one after the other, or, in many bytes of noise, at once for all of them."""

import re
from bisect import bisect_left

import numpy as np
import numpy.typing as npt

from hil.sensors.checksums import CHECKS, fitting, parts_of
from hil.sensors.declared import Protocol
from hil.sensors.layouts import Framing

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
