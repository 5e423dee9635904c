"""Columns of a record from elsewhere, written as a capture."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hil.records.atomic import replacing
from hil.records.layout import Layout
from hil.records.stream import BlockWriter

_PIECE_ROWS = 1 << 16


def write_columns(
    target: Path,
    layout: Layout,
    columns: Mapping[str, npt.NDArray[np.float64]],
    tick: npt.NDArray[np.int64] | None = None,
) -> None:
    """Write the capture `target`, whole or not at all: the columns of `layout`, (n,) each, at the numbers `tick` (n,),
    by default from 0 on without a gap.
    """
    count = len(next(iter(columns.values())))
    with replacing(target) as temporary, BlockWriter(temporary, layout) as writer:
        for start in range(0, count, _PIECE_ROWS):
            rows = np.empty(min(_PIECE_ROWS, count - start), layout.dtype)
            stop = start + rows.size
            rows["tick"] = np.arange(start, stop) if tick is None else tick[start:stop]
            for name, values in columns.items():
                rows[name] = values[start:stop]
            writer.push(rows)
        writer.close()
