"""Gain mode on the board: a filter per axis, the host's matrix, dither, rounding, limits.  The law is in docs/wire.md.

s[m] = A s[m − 1] + B V[m] + C V[m − D]
u    = limited(rounded(G [sx sx' sy sy'] + b + d[m])), held over the interval that begins at m + latency
"""

from typing import NamedTuple

import numpy as np

from device_emulator.registers import Registers
from device_emulator.scenario import MAX_LATENCY_SAMPLES

HISTORY = 64  # codes remembered, more than FILTER_DELAY can reach back
QUEUE = MAX_LATENCY_SAMPLES + 2  # drives computed and not yet acting

FEEDBACK = np.dtype(
    [
        ("a", "f8", (2, 2)),
        ("b", "f8", 2),
        ("c", "f8", 2),
        ("delay", "i8"),
        ("latency", "i8"),
        ("limit", "i8"),
        ("dither", "i8"),
        ("closed", "i8"),  # 1 while a matrix is in force
        ("gain", "f8", (2, 4)),
        ("bias", "f8", 2),
        ("s", "f8", (2, 2)),  # of each axis
        ("past", "f8", (HISTORY, 2)),  # codes, by tick
        ("shift", "u4"),  # register of the dither
        ("queue", "i4", (QUEUE, 2)),  # drive codes, by the tick at which their interval ends
        ("limited", "i8"),  # ticks at which a code had to be limited
    ],
    align=True,
)


class Matrix(NamedTuple):
    """A feedback matrix, `gain` row by row and `bias`, and the first tick computed with it (full width)."""

    matrix_id: int
    gain: tuple[float, ...]
    bias: tuple[float, ...]
    effective_tick: int


class Feedback:
    """The loop's memory between ticks, and the matrix that waits for its own.

    Attributes:
        record: shape (1,) of dtype `FEEDBACK`, for `Device.closed_rows`.
        matrix_id: of the matrix in force, 0 for none.
    """

    def __init__(self, latency: int, code_max: int) -> None:
        self.record = np.zeros(1, FEEDBACK)
        self.record["latency"] = latency
        self._code_max = code_max
        self._waiting: Matrix | None = None
        self.matrix_id = 0

    def start(self, registers: Registers) -> None:
        """Begin at ARM: filter, history and dither from their start, no matrix."""
        record = self.record[0]
        for name in ("s", "past"):
            record[name] = 0.0
        record["a"] = registers.filter_a
        record["b"] = registers.filter_b
        record["c"] = registers.filter_c
        record["delay"] = registers.filter_delay
        record["shift"] = registers.dither_seed
        self.open()

    def open(self) -> None:
        """Zero force from the next interval on, and no matrix."""
        self.record["closed"] = 0
        self.record["queue"] = 0
        self._waiting = None
        self.matrix_id = 0

    def obey(self, registers: Registers) -> None:
        """Take over the registers that may change while the loop runs."""
        self.record["limit"] = min(registers.drive_limit, self._code_max)
        self.record["dither"] = registers.dither_amplitude

    def limit(self, code: int) -> None:
        """Bring the drives computed and not yet acting within ± `code`."""
        self.record["queue"] = np.clip(self.record["queue"], -code, code)

    def put(self, matrix: Matrix) -> None:
        """Have a matrix wait for its tick, in place of one that waits already."""
        self._waiting = matrix

    def switch(self, tick: int) -> int:
        """Put the waiting matrix in force if it is due at `tick`, the next one computed; returns the tick up to which
        nothing will change.
        """
        waiting = self._waiting
        if waiting is None:
            return tick + (1 << 62)
        if waiting.effective_tick > tick:
            return waiting.effective_tick
        record = self.record[0]
        record["gain"] = np.reshape(waiting.gain, (2, 4))
        record["bias"] = waiting.bias
        record["closed"] = 1
        self.matrix_id = waiting.matrix_id
        self._waiting = None
        return tick + (1 << 62)
