"""Tables as a MATLAB file (version 5, by SciPy): a struct per table, with its columns, its units and what they mean."""

import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.exporting.exported import Exported

_MOST_BYTES = (1 << 31) - (1 << 20)
_LONGEST = 63


def write_mat(tables: Sequence[Exported], path: Path) -> None:
    """Write `tables` to `path`.  Columns are (n, 1); `units` has the unit of each, `about` what they mean, as JSON.

    Raises InputError where one is larger than the format allows.
    """
    from scipy.io import savemat

    structs = {table.name: _struct(table) for table in tables}
    savemat(path, structs, appendmat=False, long_field_names=True, do_compression=True, oned_as="column")


def _struct(table: Exported) -> dict[str, Any]:
    size = 8 * table.rows * len(table.units)
    if size > _MOST_BYTES:
        raise InputError(f"{table.name}: {size / 1e9:.3g} GB, and a MAT file holds 2 GB of each; export to parquet")
    pieces: dict[str, list[npt.NDArray[Any]]] = {name: [] for name in table.units}
    for piece in table.pieces():
        for name, values in piece.items():
            pieces[name].append(values)
    fields = dict(zip(table.units, _names(table.units), strict=True))
    struct: dict[str, Any] = {
        fields[name]: np.concatenate(parts) if parts else np.zeros(0) for name, parts in pieces.items()
    }
    struct["units"] = {fields[name]: unit for name, unit in table.units.items()}
    struct["about"] = json.dumps(table.about, ensure_ascii=True)
    return struct


def _names(columns: Iterable[str]) -> list[str]:
    """The columns as MATLAB names them: letters, digits and underscores, a letter first, none twice."""
    taken: list[str] = ["units", "about"]
    for column in columns:
        plain = re.sub(r"\W", "_", column, flags=re.ASCII)
        plain = (plain if plain[:1].isalpha() else f"c_{plain}")[:_LONGEST]
        name, count = plain, 1
        while name in taken:
            count += 1
            name = f"{plain[: _LONGEST - 4]}_{count}"
        taken.append(name)
    return taken[2:]
