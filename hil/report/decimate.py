"""Long series made drawable without hiding a spike: smallest and largest value of each column of pixels."""

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def envelope(t: Floats, values: Floats, bins: int = 700) -> tuple[Floats, Floats, Floats]:
    """Middle time, minimum and maximum (≤ bins,) of consecutive groups of samples."""
    edges = np.linspace(0, t.size, min(bins, t.size) + 1).astype(int)[:-1]
    last = np.append(edges[1:], t.size) - 1
    middle = (t[edges] + t[last]) / 2
    return middle, np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)


def line(t: Floats, values: Floats, bins: int = 700) -> tuple[Floats, Floats]:
    """A polyline of at most 2·bins points with the same envelope as the full series."""
    if t.size <= 2 * bins:
        return t, values
    middle, low, high = envelope(t, values, bins)
    both = np.stack([low, high], 1)
    both[1::2] = both[1::2, ::-1]  # up, then down: no zigzag across a steep slope's column
    return np.repeat(middle, 2), both.ravel()


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
