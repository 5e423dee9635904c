"""A table as Parquet: unit in the metadata of each column, what the numbers mean in that of the file."""

import json
from pathlib import Path

import numpy as np

from hil.exporting.exported import Exported
from hil.records.layout import HEADER_KEY


def write_parquet(table: Exported, path: Path) -> None:
    """Write `table` to `path`, piece by piece."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    pieces = table.pieces()
    first = next(pieces, None)
    columns = {name: np.zeros(0) for name in table.units} if first is None else first
    found = pa.table(columns).schema
    fields = [found.field(name).with_metadata({"unit": unit}) for name, unit in table.units.items()]
    schema = pa.schema(fields, metadata={HEADER_KEY: json.dumps(table.about)})
    with pq.ParquetWriter(path, schema) as writer:
        if first is not None:
            writer.write_table(pa.table(first, schema))
        for piece in pieces:
            writer.write_table(pa.table(piece, schema))
