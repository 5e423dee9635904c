"""Series over time as a figure needs them, gone through once and part by part: what can be drawn of them, and what the
scored window holds.

A column of pixels is drawn as its smallest and largest value, so that a spike of one sample stays visible. Numbers that
are not finite, of an observer that diverged, are left out of what is drawn and not of the figures.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Parts = Iterable[tuple[Floats, Floats]]
"""Time (n,) and values (n, k), one after another; times ascend."""

COLUMNS = 700
"""Columns of pixels of a figure as wide as the page."""
_WIDE = 4
"""Columns over which a mean is taken."""
_FEW = 1000
"""Points that are drawn one by one; more of a noisy line become a solid patch."""
DRAWABLE = 1e100
"""A figure's own arithmetic overflows somewhere beyond."""


class Held(NamedTuple):
    """What a window holds of each series (k,): rms and mean, not finite where a value is not; smallest and largest of
    what is finite, NaN where nothing is."""

    rms: Floats
    mean: Floats
    low: Floats
    high: Floats

    def size(self, series: int) -> float:
        """Largest magnitude of a series."""
        return float(np.fmax(abs(self.low[series]), abs(self.high[series])))


@dataclass(frozen=True)
class PixelSeries:
    """Series by columns of pixels: time (m,), smallest and largest (m, k); of several together their time (p,)
    and mean (p, k).

    `crowded` says that a column holds several samples; otherwise smallest and largest are the samples themselves.
    """

    t_s: Floats
    low: Floats
    high: Floats
    mean_t_s: Floats
    mean: Floats
    crowded: bool
    held: Held

    def line(self, series: int, factor: float = 1.0, offset: float = 0.0) -> tuple[Floats, Floats]:
        """A series as one polyline."""
        low, high = self.low[:, series] * factor + offset, self.high[:, series] * factor + offset
        return zigzag(self.t_s, low, high) if self.crowded else (self.t_s, low)

    def band(self, lower: int, upper: int, factor: float = 1.0) -> tuple[Floats, Floats, Floats]:
        """The outer edge of a band between two series: time, lowest, highest."""
        return self.t_s, self.low[:, lower] * factor, self.high[:, upper] * factor


def pixel_series(
    parts: Parts, span_s: tuple[float, float], rows: int, since_s: float, columns: int = COLUMNS
) -> PixelSeries:
    """The course of series that come in parts.

    Args:
        parts: `rows` at most in all, of times within `span_s`.
        since_s: where scoring starts; when no time is that late, all of them are scored.
        columns: of pixels; a series of few samples keeps each.
    """
    fine = _Columns(span_s, columns) if rows > _FEW else None
    scored, every = _Window(), _Window()
    single: list[tuple[Floats, Floats]] = []
    with np.errstate(all="ignore"):
        for t, values in parts:
            shown = np.where(np.abs(values) < DRAWABLE, values, np.nan)
            every.add(values)
            scored.add(values[np.searchsorted(t, since_s) :])
            if fine is None:
                single.append((t, shown))
            else:
                fine.add(t, shown)
        held = scored.held if scored.count else every.held
        if fine is not None:
            return PixelSeries(*fine.extremes(), *fine.means(), True, held)
    at = np.concatenate([t for t, _ in single])
    points = np.concatenate([values for _, values in single])
    return PixelSeries(at, points, points, at, points, False, held)


def zigzag(middle: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """An envelope as one polyline."""
    both = np.stack([low, high], 1)
    both[1::2] = both[1::2, ::-1]  # up, then down: no zigzag across a steep slope's column
    return np.repeat(middle, 2), both.ravel()


def first_since(parts: Parts, since_s: float) -> Floats:
    """The values (k,) where scoring starts; the very first where no time is that late."""
    first: Floats | None = None
    for t, values in parts:
        found = np.flatnonzero(t >= since_s)
        if found.size:
            return np.asarray(values[found[0]])
        if first is None and len(values):
            first = values[0]
    assert first is not None
    return first


def spread(values: Callable[[], Iterator[Floats]], rows: int, most: int = 1 << 20) -> Floats:
    """Of a series (n,) in parts, `rows` at most in all: so many values, evenly spread; all where there are no more."""
    every, at, kept = -(-rows // most) or 1, 0, []
    for part in values():
        kept.append(part[-at % every :: every])
        at += part.size
    return np.concatenate(kept) if kept else np.empty(0)


class _Window:
    def __init__(self) -> None:
        self.count = 0
        self._sums: Floats = np.zeros((2, 0))
        self._ends: Floats = np.zeros((2, 0))

    def add(self, values: Floats) -> None:
        if not self._sums.size:
            self._sums = np.zeros((2, values.shape[1]))
            self._ends = np.full((2, values.shape[1]), np.nan)
        if not len(values):
            return
        self.count += len(values)
        self._sums += [np.sum(values, axis=0), np.sum(values**2, axis=0)]
        finite = np.where(np.isfinite(values), values, np.nan)
        self._ends = np.stack(
            [
                np.fmin(self._ends[0], np.fmin.reduce(finite)),
                np.fmax(self._ends[1], np.fmax.reduce(finite)),
            ]
        )

    @property
    def held(self) -> Held:
        mean, square = self._sums / max(self.count, 1)
        return Held(np.sqrt(square), mean, *self._ends)


class _Columns:
    """Columns of equal width over a span of time: smallest, largest and sum of what falls into each."""

    def __init__(self, span_s: tuple[float, float], columns: int) -> None:
        self._start, stop = span_s
        self._per_s = columns / (stop - self._start) if stop > self._start else 0.0
        self._columns = columns
        self._rows, self._time = np.zeros(columns), np.zeros(columns)
        self._count: Floats | None = None

    def add(self, t: Floats, values: Floats) -> None:
        if not t.size:
            return
        if self._count is None:
            shape = self._columns, values.shape[1]
            self._count, self._sum = np.zeros(shape), np.zeros(shape)
            self._low, self._high = np.full(shape, np.nan), np.full(shape, np.nan)
        column = np.clip((t - self._start) * self._per_s, 0, self._columns - 1).astype(int)
        begins = np.flatnonzero(np.diff(column, prepend=-1))
        at = column[begins]
        finite = np.isfinite(values)
        self._rows[at] += np.diff(begins, append=t.size)
        self._time[at] += np.add.reduceat(t, begins)
        self._count[at] += np.add.reduceat(finite, begins, dtype=float)
        self._sum[at] += np.add.reduceat(np.where(finite, values, 0.0), begins)
        self._low[at] = np.fmin(self._low[at], np.fmin.reduceat(values, begins))
        self._high[at] = np.fmax(self._high[at], np.fmax.reduceat(values, begins))

    def extremes(self) -> tuple[Floats, Floats, Floats]:
        """Mean time of the columns into which something fell, its smallest and its largest."""
        assert self._count is not None
        used = self._rows > 0
        return self._time[used] / self._rows[used], self._low[used], self._high[used]

    def means(self) -> tuple[Floats, Floats]:
        """Mean time and mean value of columns taken together."""
        assert self._count is not None
        begins = np.arange(0, self._columns, _WIDE)
        rows, time = np.add.reduceat(self._rows, begins), np.add.reduceat(self._time, begins)
        count, total = np.add.reduceat(self._count, begins), np.add.reduceat(self._sum, begins)
        used = rows > 0
        return time[used] / rows[used], np.where(count > 0, total / count, np.nan)[used]
