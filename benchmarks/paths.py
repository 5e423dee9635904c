"""Speed of what stands around the step, each beside a peer that does the bare least of it, in the same run.

Ours and the peer by turns, round after round; a figure is the median, a ratio the median of the rounds' ratios, its
spread their quartiles.  Times are the processor's, of this process.

The wire: a block of SENSE decoded, beside COBS and CRC of the same frames by the libraries alone.
"""

import statistics
import time
from collections.abc import Callable

import numpy as np
from cobs import cobs
from crc32c import crc32c

from benchmarks.row import Row, Say
from hil.wire.sense import Sense
from hil.wire.stream import Receiver, Transmitter

ROUNDS = 5
BLOCK, BLOCKS = 250, 400

Timed = Callable[[], float]


def rows(say: Say) -> list[Row]:
    """All of it."""
    figures = [decoding()]
    say("wire")
    return figures


def beside(
    name: str, unit: str, per: float, ours: Callable[[], object], peer: str, theirs: Callable[[], object]
) -> Row:
    """Ours over the peer's, a unit being `per` seconds."""
    found: tuple[list[float], list[float]] = ([], [])
    for round_ in range(ROUNDS + 1):
        for kept, call in zip(found, (ours, theirs), strict=True):
            begun = time.process_time()
            call()
            if round_:  # the first warms up
                kept.append((time.process_time() - begun) / per)
    return Row.over(name, statistics.median(found[0]), unit, peer, np.array(found[0]) / np.array(found[1]))


def decoding() -> Row:
    """Gain mode's blocks on a serial line."""
    codes = np.random.default_rng(1).integers(-(2**15), 2**15, (BLOCK, 4)).astype(np.int32)
    board = Transmitter()
    frames = [board.encode(Sense(codes, 2, 0), n * BLOCK) for n in range(BLOCKS)]

    def ours() -> None:
        host = Receiver()
        messages = (item.message for data in frames for item in host.feed(data))
        assert sum(len(message.codes) for message in messages if isinstance(message, Sense)) == BLOCK * BLOCKS

    def bare() -> None:
        for data in frames:
            for frame in data.split(b"\0"):
                if frame:
                    crc32c(cobs.decode(frame))

    return beside("a block of SENSE decoded", "µs a sample", 1e-6 * BLOCK * BLOCKS, ours, "COBS and CRC alone", bare)
