"""Lowest and highest value for each bucket of ticks, while the ticks come."""

import numpy as np
import numpy.typing as npt

from hil.service.telemetry.history import History

_BUCKET = np.dtype([("number", "<i8"), ("low", "<f4"), ("high", "<f4")])

Floats = npt.NDArray[np.float32]


def stretches(ticks: npt.NDArray[np.int64], values: npt.NDArray[np.float32], step: int) -> npt.NDArray[np.void]:
    """Number (tick // step), lowest and highest value of each bucket that has a row; ticks ascend."""
    number = ticks // step
    found = np.empty(0, _BUCKET)
    if number.size:
        starts = np.concatenate([[0], np.flatnonzero(np.diff(number)) + 1])
        found = np.empty(len(starts), _BUCKET)
        found["number"] = number[starts]
        found["low"] = np.fmin.reduceat(values, starts)
        found["high"] = np.fmax.reduceat(values, starts)
    return found


def dense(found: npt.NDArray[np.void], first: int, count: int) -> tuple[Floats, Floats]:
    """Lowest and highest value (count,) of the buckets from number `first` on, NaN where nothing was recorded."""
    low = np.full(count, np.nan, np.float32)
    high = low.copy()
    at = found["number"] - first
    inside = (at >= 0) & (at < count)
    low[at[inside]] = found["low"][inside]
    high[at[inside]] = found["high"][inside]
    return low, high


class Roll:
    """The last `buckets` buckets of `step` ticks of one channel."""

    def __init__(self, step: int, buckets: int) -> None:
        self.step, self.buckets = step, buckets
        self._kept = History(_BUCKET, buckets + 1)
        self._open = np.empty(0, _BUCKET)  # the newest, to which more may come

    def add(self, ticks: npt.NDArray[np.int64], values: npt.NDArray[np.float32]) -> None:
        """Rows that follow those before."""
        found = stretches(ticks, values, self.step)
        if not found.size:
            return
        if self._open.size:
            if found["number"][0] == self._open["number"][0]:
                found["low"][0] = np.fmin(found["low"][0], self._open["low"][0])
                found["high"][0] = np.fmax(found["high"][0], self._open["high"][0])
            else:
                self._kept.add(self._open)
        self._kept.add(found[:-1])
        self._open = found[-1:].copy()

    @property
    def next(self) -> int:
        """Number of the bucket to which more may come: those before it are whole. 0 before the first row."""
        return int(self._open["number"][0]) if self._open.size else 0

    def between(self, first: int, stop: int) -> tuple[Floats, Floats]:
        """Buckets first … stop − 1, which are whole."""
        return dense(self._kept.newest(self.buckets + 1), first, stop - first)
