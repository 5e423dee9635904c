"""`instruments.arrow`: what a table or a chamber really did while a run lasted, on the host's clock."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from hil.records.blocks import read_blocks
from hil.records.layout import HOST, TICK, Column, Layout
from hil.records.stream import write_counted

COLUMNS = {"table": Column("table_rate_dps", "f8", "°/s"), "chamber": Column("chamber_C", "f8", "°C")}
_BLOCK_ROWS = 256


def write_instruments(folder: Path, names: Sequence[str], rows: Sequence[tuple[float, ...]]) -> None:
    """Write the file into a run folder; rows: host time [ns, monotonic], then the value of each of `names`."""
    columns = (TICK, Column("host_ns", "i8", "ns", clock=HOST), *(COLUMNS[name] for name in names))
    layout = Layout("instruments", columns, _BLOCK_ROWS, {"tick_rate_Hz": 1.0})
    write_counted(folder / "instruments.arrow", layout, rows)


def read_instruments(folder: Path) -> Mapping[str, np.ndarray]:
    """Values (n,) by instrument, and `host_ns`."""
    found = read_blocks(folder / "instruments.arrow", "instruments").columns
    names = {"host_ns": "host_ns", **{name: column.name for name, column in COLUMNS.items()}}
    return {name: np.asarray(found[column]) for name, column in names.items() if column in found}
