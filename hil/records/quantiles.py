"""Quantiles of more numbers than memory holds, exactly: ranks are narrowed down over a few passes.

A number's bits, read as an integer, rank like the number (with the sign taken care of: M. Herf, "Radix tricks", 2001).
A pass counts them by sixteen bits at a time, those only that could still be of a wanted rank.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Pass = Callable[[], Iterable[Floats]]

_BITS = 16
_FEW = 1 << 20
"""So many candidates are sorted instead."""


def quantiles(values: Pass, fractions: Sequence[float]) -> list[float] | None:
    """Quantiles as `numpy.quantile` gives them, by linear interpolation; None of an empty set or one with a NaN.

    `values` begins a pass: the numbers in parts (n,), the same ones each time.
    """
    count = 0
    for part in values():
        if np.isnan(part).any():
            return None
        count += part.size
    if not count:
        return None
    found = []
    for fraction in fractions:
        place = fraction * (count - 1)
        below = int(place)
        low, high = _ranked(values, below), _ranked(values, min(below + 1, count - 1)) if place > below else 0.0
        found.append(low if place == below else low + (high - low) * (place - below))
    return found


def _ranked(values: Pass, rank: int) -> float:
    """The number of which `rank` others are smaller."""
    prefix, known = np.uint64(0), 0
    while True:
        shift = np.uint64(64 - known - _BITS)
        counts = np.zeros(1 << _BITS, np.int64)
        for part in values():
            keys = _alike(_keys(part), prefix, known)
            counts += np.bincount((keys >> shift & np.uint64((1 << _BITS) - 1)).astype(np.int64), minlength=1 << _BITS)
        ends = np.cumsum(counts)
        digit = int(np.searchsorted(ends, rank, side="right"))
        rank -= int(ends[digit] - counts[digit])
        prefix = prefix << np.uint64(_BITS) | np.uint64(digit)
        known += _BITS
        if counts[digit] <= _FEW or known == 64:
            break
    left = np.concatenate([_alike(_keys(part), prefix, known) for part in values()]) if known < 64 else prefix
    return _number(np.partition(left, rank)[rank] if known < 64 else np.uint64(prefix))


def _keys(values: Floats) -> npt.NDArray[np.uint64]:
    bits = np.ascontiguousarray(values, np.float64).view(np.uint64)
    negative = bits >> np.uint64(63) == 1
    return np.where(negative, ~bits, bits | np.uint64(1 << 63))


def _alike(keys: npt.NDArray[np.uint64], prefix: np.uint64, known: int) -> npt.NDArray[np.uint64]:
    return keys[keys >> np.uint64(64 - known) == prefix] if known else keys


def _number(key: np.uint64) -> float:
    bits = key & np.uint64((1 << 63) - 1) if key >> np.uint64(63) else ~key
    return float(np.array([bits], np.uint64).view(np.float64)[0])
