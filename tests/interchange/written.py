"""One record in every kind of source, and its map."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.io import savemat

from hil.importing.importer import import_file
from hil.importing.request import ImportRequest
from hil.library.given import write_capture
from hil.records.capture import Capture, read_capture

ROWS = 60
T_S = np.arange(ROWS) / 100.0
X_V = np.round(np.sin(7.0 * T_S), 6)
U_V = np.round(np.cos(3.0 * T_S), 6)
SENSOR = 1 + np.arange(ROWS) % 2
COLUMNS: dict[str, Any] = {"t": T_S, "x": X_V, "u": U_V, "sensor": SENSOR}
MAP = """\
hold = "foh"
[columns]
t_s = { column = "t", unit = "s" }
vx_V = { column = "x", unit = "V" }
ux_V = { column = "u", unit = "V" }
"""
KINDS = ("text", "MATLAB", "Parquet", "arrays")


def bring(kind: str, place: Path, columns: dict[str, Any], mapping: str | None = MAP, **options: Any) -> Capture:
    """The record `columns`, written as that kind and imported by the text of a map."""
    map_file = None
    if mapping is not None:
        map_file = place / "made.map.toml"
        map_file.write_text(mapping, encoding="utf-8")
    target = place / "made.arrow"
    if kind == "arrays":
        write_capture(columns, target, map_file=map_file, **options)
        return read_capture(target)
    return import_file(ImportRequest(_WRITERS[kind](place, columns), target, map_file=map_file, **options)).capture


def _text(place: Path, columns: dict[str, Any]) -> Path:
    path = place / "made.csv"
    rows = zip(*(values.tolist() if hasattr(values, "tolist") else values for values in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join("" if cell is None else str(cell) for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _matlab(place: Path, columns: dict[str, Any]) -> Path:
    savemat(place / "made.mat", {name: np.asarray(values) for name, values in columns.items()})
    return place / "made.mat"


def _parquet(place: Path, columns: dict[str, Any]) -> Path:
    pq.write_table(pa.table(columns), place / "made.parquet")
    return place / "made.parquet"


_WRITERS: dict[str, Callable[[Path, dict[str, Any]], Path]] = {"text": _text, "MATLAB": _matlab, "Parquet": _parquet}
