"""What the readings of a record say by themselves: a rail that they stop at, values that never come, two levels.

None of the three is a function of the motion that is smoothed through such readings: at a rail and at a lost value the
reading says less than it seems, and is set aside while the motion is looked for.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from estimator.scaling import Array

_WIDE = 3.0  # deviations of the noise, half a bin at the rail
_PILED = 6.0  # samples in the last bin over those in the one before; a sine of one amplitude has 2.4
_AWAY = 20.0  # deviations of the noise from the middle, below which the axis stands still
_LEAST = 30.0  # samples at a rail
_DUE = 12.0  # samples that a gap should have: none is there by chance once in 100,000 gaps
_HELD = 0.5  # of them, that its edge must have


@dataclass(frozen=True, eq=False)
class Readings:
    """rail: largest |reading| that is sensed, scaled; None where there is none; lost: by axis, values (gaps, 2) between
    which none comes, all of which read as the first; levels (n, axes): −1 or 1, 0 where there is one level only; flips
    (axes,): how often they change.
    """

    rail: float | None = None
    lost: tuple[Array, ...] = ()
    levels: Array = field(default_factory=lambda: np.zeros((0, 2)))
    flips: tuple[int, ...] = ()

    def part(self, rows: slice) -> "Readings":
        """Those of `rows`."""
        return replace(self, levels=self.levels[rows])

    def scaled(self, unit: Array) -> "Readings":
        """In another unit for each axis."""
        rail = None if self.rail is None else self.rail / abs(float(unit[0]))
        return replace(self, rail=rail, lost=tuple(gaps / one for gaps, one in zip(self.lost, unit, strict=True)))

    def taken(self, axis: int, due: Array, sensed: Array) -> Array:
        """What lost values take of the readings (n,) that are due, where those that are sensed stand at one."""
        out = np.zeros(len(due))
        for low, high in self.lost[axis]:
            width = abs(float(high - low))
            out = np.where(sensed == low, np.clip(low - due, -width, width), out)
        return out

    def hide(self, sense: Array, noise: Array) -> NDArray[np.bool_]:
        """Samples (n,) of which a reading says less than it seems."""
        hidden = np.zeros(len(sense), dtype=bool)
        for axis in range(sense.shape[1]):
            if self.rail is not None:
                hidden |= np.abs(sense[:, axis]) > self.rail - _WIDE * noise[axis]
            for low, _ in self.lost[axis]:
                hidden |= sense[:, axis] == low
        return hidden


def readings_of(sense: Array, noise: Array) -> Readings:
    """Rail and lost values of readings (n, axes), scaled; noise (axes,)."""
    rails = [level for axis in range(sense.shape[1]) for level in rails_of(sense[:, axis], float(noise[axis]))]
    return Readings(float(np.median(rails)) if rails else None, tuple(lost_of(series) for series in sense.T))


def rails_of(sense: Array, noise: float) -> list[float]:
    """Levels, on either side of zero, at which readings (n,) pile up within the noise and beyond which none comes."""
    bins = 2.0 * _WIDE * noise
    found = []
    for side in (sense, -sense):
        there = side[np.isfinite(side)]
        if not len(there):
            continue
        # The noise takes the largest readings above the rail: its middle is where they are densest.
        top = float(np.max(there))
        near = there[there > top - 2.0 * bins]
        level = float(np.median(near[near > top - bins]))
        at = int(np.count_nonzero(np.abs(there - level) <= 0.5 * bins))
        below = int(np.count_nonzero((there < level - 0.5 * bins) & (there >= level - 1.5 * bins)))
        still = level - float(np.median(there)) < _AWAY * noise
        if at > _LEAST and at > _PILED * max(below, 1) and not still:
            found.append(level)
    return found


def lost_of(sense: Array) -> Array:
    """Values (gaps, 2) of readings (n,) between which there is none, though on either side of them there are many, and
    those that are missing stand at the first of the two.
    """
    values, counts = np.unique(sense[np.isfinite(sense)], return_counts=True)
    total = np.concatenate([[0], np.cumsum(counts)])
    found = []
    steps = np.diff(values)
    for i in np.flatnonzero(steps > 8.0 * np.median(steps)) if len(values) > 2 else []:
        low, high = float(values[i]), float(values[i + 1])
        width = high - low
        below = total[i] - total[np.searchsorted(values, low - width)]
        above = total[np.searchsorted(values, high + width)] - total[i + 1]
        due = min(below, above)
        if due > _DUE and counts[i] > _HELD * due:
            found.append((low, high))
    return np.array(found).reshape(-1, 2)
