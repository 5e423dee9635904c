"""Long series made drawable without hiding a spike: smallest and largest value of each column of pixels."""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def envelope(t: Floats, values: Floats, bins: int = 700) -> tuple[Floats, Floats, Floats]:
    """Middle time, minimum and maximum (≤ bins,) of consecutive groups of samples."""
    edges = np.linspace(0, t.size, min(bins, t.size) + 1).astype(int)[:-1]
    last = np.append(edges[1:], t.size) - 1
    middle = (t[edges] + t[last]) / 2
    return middle, np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)


def envelopes(parts: Iterable[tuple[Floats, Floats]], rows: int, bins: int = 700) -> tuple[Floats, Floats, Floats]:
    """`envelope` of several series at once that come in parts (time (n,), values (n, k)), `rows` in all.

    Gives middle time (≤ bins,), minimum and maximum (≤ bins, k).
    """
    edges = np.linspace(0, rows, min(bins, rows) + 1).astype(int)
    starts, last = edges[:-1], edges[1:] - 1
    middle: Floats = np.zeros(starts.size)
    low = high = np.empty((0, 0))
    begin = 0
    for t, values in parts:
        if not low.size:
            low, high = (
                np.full((starts.size, values.shape[1]), np.inf),
                np.full((starts.size, values.shape[1]), -np.inf),
            )
        end = begin + t.size
        for ends in (starts, last):
            inside = (ends >= begin) & (ends < end)
            middle[inside] += t[ends[inside] - begin] / 2
        bin_ = slice(np.searchsorted(starts, begin, "right") - 1, np.searchsorted(starts, end))
        at = np.maximum(starts[bin_] - begin, 0)
        low[bin_] = np.minimum(low[bin_], np.minimum.reduceat(values, at))
        high[bin_] = np.maximum(high[bin_], np.maximum.reduceat(values, at))
        begin = end
    return middle, low, high


def zigzag(middle: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """An envelope as one polyline."""
    both = np.stack([low, high], 1)
    both[1::2] = both[1::2, ::-1]  # up, then down: no zigzag across a steep slope's column
    return np.repeat(middle, 2), both.ravel()


def line(t: Floats, values: Floats, bins: int = 700) -> tuple[Floats, Floats]:
    """A polyline of at most 2·bins points with the same envelope as the full series."""
    if t.size <= 2 * bins:
        return t, values
    return zigzag(*envelope(t, values, bins))


def band(t: Floats, low: Floats, high: Floats, bins: int = 700) -> tuple[Floats, Floats, Floats]:
    """A band's outer edge: lowest low and highest high of each group."""
    middle, lowest, _ = envelope(t, low, bins)
    _, _, highest = envelope(t, high, bins)
    return middle, lowest, highest


def means(t: Floats, values: Floats, bins: int = 160) -> tuple[Floats, Floats]:
    """Middle time and mean (≤ bins,) of consecutive groups of samples."""
    edges = np.linspace(0, t.size, min(bins, t.size) + 1).astype(int)
    middle = (t[edges[:-1]] + t[edges[1:] - 1]) / 2
    return middle, np.add.reduceat(values, edges[:-1]) / np.diff(edges)
