"""The amplitude of a ring-down as it was recorded, and what is declared of the device."""

from dataclasses import dataclass

import numpy as np

from estimator.errors import ModelError
from estimator.scaling import Array, Scaling
from estimator.settings import Device

DECIBEL = 20.0 / float(np.log(10.0))
"""Decibels of a factor e in amplitude."""
FEWEST = 40
"""Samples: a start, the damping and three laws, each from eight."""


@dataclass(frozen=True)
class Envelope:
    """time (n,) s, increasing; shown (n,): the amplitude in the sensor's unit, or, where `logarithmic`, in dB of one of
    them.

    Raises ModelError for series that do not fit, and for an amplitude that is no positive number.
    """

    time: Array
    shown: Array
    logarithmic: bool

    def __post_init__(self) -> None:
        if len(self.time) != len(self.shown):
            raise ModelError(f"{len(self.shown)} amplitudes at {len(self.time)} times; give each its own")
        if len(self.time) < FEWEST:
            raise ModelError(f"{len(self.time)} samples of an envelope are too few; record at least {FEWEST}")
        if not np.all(np.diff(self.time) > 0.0):
            raise ModelError("the times of an envelope do not increase; sort them")
        good = np.isfinite(self.shown) & (True if self.logarithmic else self.shown > 0.0)
        if not np.all(good):
            row = int(np.argmin(good))
            raise ModelError(f"the amplitude of row {row} is {self.shown[row]:g}, which is none; leave the row out")

    def __len__(self) -> int:
        return len(self.time)

    def level_over(self, unit: float) -> Array:
        """ln of the amplitude (n,) over `unit` of the sensor's."""
        if self.logarithmic:
            return np.asarray(self.shown / DECIBEL - np.log(unit))
        return np.asarray(np.log(self.shown / unit))


@dataclass(frozen=True)
class Resonator:
    """What is declared of the device that rings down.

    damping: dxx and its standard deviation, 1/s; frequency_sd: relative, of the resonance; noise: rms of one sample, in
    the sensor's unit, or in dB.
    """

    device: Device
    damping: tuple[float, float]
    frequency_sd: float
    noise: float

    @property
    def scaling(self) -> Scaling:
        """From scaled to SI."""
        return Scaling.of(self.device)

    @property
    def unit(self) -> float:
        """The sensor's units of one scaled unit of amplitude."""
        return abs(self.scaling.sense(0))
