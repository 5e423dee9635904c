"""Samples as the turn in C has them (`hil.running.native.ROW`), and as messages and tuples of Python."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from hil.running.native import ROW
from hil.wire.sense import COLUMNS, Sense, SenseRow
from hil.wire.stream import Received


def rows_of(items: Iterable[Received]) -> NDArray[np.void]:
    """The samples of the SENSE among messages."""
    parts = [np.zeros(0, ROW)]
    for tick, _, sense in items:
        if isinstance(sense, Sense):
            size = len(sense.codes)
            part = np.zeros(size, ROW)
            part["tick"] = np.arange(tick, tick + size)
            for column, name in enumerate(COLUMNS):
                part[name] = sense.codes[:, column]
            part["flags"], part["matrix"] = sense.flags, sense.matrix_id
            part["left"] = np.arange(size, 0, -1)
            parts.append(part)
    return np.concatenate(parts)


def row_of(row: np.void) -> SenseRow:
    """One sample as plain integers."""
    tick, vx, vy, ux, uy, flags, _, _ = row.tolist()
    return tick, vx, vy, ux, uy, flags
