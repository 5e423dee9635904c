"""A table as text: a header line with units in the names, one row a line. A capture reads back with `hil import`."""

from pathlib import Path

from hil.exporting.exported import Exported

_BOOKKEEPING = ("tick", "flags")


def write_csv(table: Exported, path: Path) -> None:
    """Write `table` to `path`, without tick and flags."""
    import pyarrow as pa
    import pyarrow.csv as pa_csv

    names = [name for name in table.units if name not in _BOOKKEEPING]
    options = pa_csv.WriteOptions(include_header=False)
    with path.open("wb") as file:
        file.write((",".join(names) + "\n").encode())
        for piece in table.pieces():
            pa_csv.write_csv(pa.table({name: piece[name] for name in names}), file, options)
