"""Samples of one rate sensor beside a reference for the rate."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from estimator.errors import ModelError
from estimator.scaling import Array

FEWEST = 8


@dataclass(frozen=True)
class SensorRecord:
    """What was turned and what was read.

    rate (n,) rad/s of the reference; voltage (n,) V; step [s] between samples, None where every row is a steady state
    of its own (a table of means), which says nothing of dynamics; temperature (n,) °C or None; number (n,): of each
    sample among those that are missing too, None where none is.
    Raises ModelError for series of unequal length, too few samples, and values that are not numbers.
    """

    rate: Array
    voltage: Array
    step: float | None = None
    temperature: Array | None = None
    number: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        series = {"rate": self.rate, "voltage": self.voltage}
        if self.temperature is not None:
            series["temperature"] = self.temperature
        for name, values in series.items():
            if len(values) != len(self.rate):
                raise ModelError(f"{name} has {len(values)} rows, rate has {len(self.rate)}; give each sample its own")
            finite = np.isfinite(values)
            if not finite.all():
                raise ModelError(f"{name}: row {int(np.argmin(finite))} is not a number; leave the row out")
        if len(self.rate) < FEWEST:
            raise ModelError(f"{len(self.rate)} samples of a rate sensor are too few; record at least {FEWEST}")

    def __len__(self) -> int:
        return len(self.rate)

    def upto(self, samples: int) -> "SensorRecord":
        """The first samples only."""
        temperature = None if self.temperature is None else self.temperature[:samples]
        number = None if self.number is None else self.number[:samples]
        return SensorRecord(self.rate[:samples], self.voltage[:samples], self.step, temperature, number)

    @property
    def time(self) -> Array:
        """Time of each sample (n,) from the first, s; for steady states their number."""
        number = np.arange(len(self)) if self.number is None else self.number - self.number[0]
        return np.asarray(number * (1.0 if self.step is None else self.step), dtype=np.float64)

    @property
    def stretches(self) -> tuple[slice, ...]:
        """Its parts between gaps: what the rate was in one nobody knows, so that each has a start of its own."""
        cuts = [] if self.number is None else (np.flatnonzero(np.diff(self.number) > 1) + 1).tolist()
        return tuple(slice(begin, end) for begin, end in pairwise([0, *cuts, len(self)]))
