"""What tracing works on: the samples of one record, as numbers."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from estimator.gaps import Gaps
from estimator.scaling import Array


@dataclass(frozen=True)
class Record:
    """Samples of one record, SI; a lost sample has NaN in `sense`.

    sense (n, axes) V; drive (n, axes, degree + 1) polynomials over the interval that ends at each sample
    (`estimator.hold`); step (n,) s, that interval's length; channels: further measured series (n,), by name:
    `temperature` [°C], `rate` [rad/s], a reference for the rate that is scored and never given to the observer, `gyro`
    [rad/s], the same of a gyro with a bias, a scale and a delay of its own; gaps: where the drive is a prediction, None
    where it is known throughout; filtered: whether sense and drive passed a filter, behind which noise is not white.
    """

    sense: Array
    drive: Array
    step: Array
    channels: Mapping[str, Array] = field(default_factory=dict)
    gaps: Gaps | None = None
    filtered: bool = False

    def __len__(self) -> int:
        return len(self.sense)

    def part(self, rows: slice) -> "Record":
        """The samples of `rows`."""
        channels = {name: series[rows] for name, series in self.channels.items()}
        gaps = None if self.gaps is None else self.gaps.part(slice(*rows.indices(len(self))))
        return Record(self.sense[rows], self.drive[rows], self.step[rows], channels, gaps, self.filtered)

    @property
    def reference(self) -> Array | None:
        """What the rate is scored against (n,), None without any."""
        return self.channels.get("rate", self.channels.get("gyro"))

    @property
    def stretches(self) -> tuple[slice, ...]:
        """The record cut behind its gaps: over each part the drive is known from its first sample on."""
        behind = [] if self.gaps is None else self.gaps.behind.tolist()
        return tuple(slice(begin, end) for begin, end in pairwise([0, *behind, len(self)]) if end > begin)

    @property
    def time(self) -> Array:
        """Time of each sample (n,) from the first one, s."""
        return np.asarray(np.cumsum(self.step) - self.step[0])
