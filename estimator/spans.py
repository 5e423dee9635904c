"""Where a condition holds along a record."""

import numpy as np
from numpy.typing import ArrayLike


def spans(mask: ArrayLike) -> list[tuple[int, int]]:
    """Runs of True in a mask (n,), each as [begin, end)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.asarray(mask, bool), [False]]).astype(np.int8)))
    return [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]
