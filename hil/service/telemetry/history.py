"""The newest rows of a stream, in order, in memory that does not grow."""

from typing import Any

import numpy as np
import numpy.typing as npt

Rows = npt.NDArray[np.void]


class History:
    """The last `most` rows of a dtype, and perhaps as many before them."""

    def __init__(self, dtype: np.dtype[Any], most: int) -> None:
        self._rows = np.empty(2 * most, dtype)
        self._most = most
        self._count = 0
        self.added = 0
        """rows ever"""

    def add(self, rows: Rows) -> None:
        """Append rows; the oldest are forgotten."""
        self.added += len(rows)
        rows = rows[-self._most :]
        if self._count + len(rows) > len(self._rows):
            kept = self._most - len(rows)
            self._rows[:kept] = self._rows[self._count - kept : self._count].copy()
            self._count = kept
        self._rows[self._count : self._count + len(rows)] = rows
        self._count += len(rows)

    def newest(self, count: int) -> Rows:
        """The last `count` rows, or as many as there are; a view that holds until more are added."""
        return self._rows[max(self._count - count, 0) : self._count]
