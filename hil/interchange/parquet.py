"""Parquet files whose columns are named as those of the interchange CSV, which `hil export --to parquet` writes."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import get_args

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from hil.errors import InputError
from hil.records.capture import Hold
from hil.records.layout import HEADER_KEY

_MAGIC = b"PAR1"
_OURS = ("tick", "flags")  # of an export: what a record counts and marks by itself


def is_parquet(source: Path) -> bool:
    """Whether the file is one, by its first bytes."""
    try:
        with source.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


def read_parquet(source: Path) -> tuple[list[str], npt.NDArray[np.float64], Hold]:
    """Names of the columns, their values (rows, columns), and what the drive did between samples, as an export says.

    Raises InputError that names the file and the column.
    """
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(source) as file:
            names = [name for name in file.schema_arrow.names if name not in _OURS]
            hold = _hold(file.schema_arrow.metadata or {})
            values = np.empty((file.metadata.num_rows, len(names)))
            first = 0
            for batch in file.iter_batches(columns=names):
                for index, column in enumerate(batch.columns):
                    values[first : first + batch.num_rows, index] = _numbers(source, names[index], column)
                first += batch.num_rows
    except (pa.ArrowException, OSError, MemoryError, OverflowError):
        raise InputError(f"{source}: no Parquet file that can be read; export it anew") from None
    return names, values[:first], hold


def _hold(metadata: Mapping[bytes, bytes]) -> Hold:
    """Of an export; zoh where the file says nothing."""
    try:
        told = json.loads(metadata.get(HEADER_KEY, b"{}")).get("hold")
    except (ValueError, AttributeError, RecursionError):
        told = None
    return next((hold for hold in get_args(Hold) if hold == told), "zoh")


def _numbers(source: Path, name: str, column: pa.Array) -> npt.NDArray[np.float64]:
    """A column as numbers, all of them measurements."""
    kind = column.type
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
        raise InputError(f"{source}: column {name}: {kind} is no number; leave the column out")
    numbers: npt.NDArray[np.float64] = np.asarray(column.cast(pa.float64()).fill_null(np.nan), dtype=float)
    if not np.isfinite(numbers).all():
        row = int(np.flatnonzero(~np.isfinite(numbers))[0])
        raise InputError(f"{source}: column {name}: row {row} of a part holds no measurement; leave the row out")
    return numbers
