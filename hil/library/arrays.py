"""A record given as arrays becomes a capture, as one from a file does."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy.typing as npt

from hil.importing.array_source import ArraySource
from hil.importing.demodulated import carrier_of
from hil.importing.importer import import_from, require_keys_act
from hil.importing.mapping import read_map
from hil.importing.record_time import Remedies
from hil.library.series import Series
from hil.records.capture import Hold

CALLED = "the arrays given"
_REMEDIES = Remedies(
    uneven="give nonuniform=True if the record is meant so",
    gaps="give nonuniform=True to keep them as gaps",
    rate="beside t_s in a map given as mapping=",
    sort="sort the rows",
    column="t_s",
    apart="give what lies before and behind by itself",
)


class Table(Protocol):
    """Columns by name: a Series, a frame of pandas, a table of pyarrow."""

    @property
    def columns(self) -> Any:
        """Their names, or in pyarrow themselves."""

    def __getitem__(self, name: Any, /) -> Any: ...


def columns_of(record: Any) -> dict[str, npt.ArrayLike] | None:
    """The arrays of a record by name: of a mapping, a Series, or a table of pandas or pyarrow, whose time may be the
    index; None where it is none of them.
    """
    if isinstance(record, Series):
        return {"t_s": record.t_s, **{name: record[name] for name in record}}
    if isinstance(record, Mapping):
        names = list(record)
    elif hasattr(record, "columns"):
        if getattr(getattr(record, "index", None), "name", None) == "t_s":
            record = record.reset_index()
        names = list(getattr(record, "column_names", record.columns))
    else:
        return None
    return {str(name): record[name] for name in names}


def write_capture(
    columns: Mapping[str, npt.ArrayLike],
    target: Path,
    *,
    hold: Hold | None = None,
    nonuniform: bool = False,
    map_file: Path | None = None,
    demodulated: str | None = None,
) -> None:
    """Write the capture of `columns`, (n,) each, by the map at `map_file`, or by their names in an interchange CSV:
    t_s, vx_V, vy_V, ux_mps2 and uy_mps2 (or _V, _N), and optionally rate_rad_s and temp_C; a single axis leaves out y.
    demodulated: as `hil import --demodulated`.

    Time may be datetime64, timedelta64 or ISO 8601 text too, and is even unless `nonuniform`.  Raises InputError that
    names the column.
    """
    mapping = None if map_file is None else read_map(map_file)
    if mapping is not None:
        require_keys_act(mapping, ArraySource.kind, CALLED, map_file)
    source = ArraySource(columns, CALLED)
    import_from(
        source, target, mapping, map_file=map_file, hold=hold, nonuniform=nonuniform, remedies=_REMEDIES,
        carrier=carrier_of(demodulated),
    )  # fmt: skip
