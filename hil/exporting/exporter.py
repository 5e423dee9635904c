"""`hil export`: what a run recorded and estimated, as CSV, Parquet, MAT or MCAP, in SI units."""

import heapq
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.exporting.exported import WHAT, Columns, Exported, What, tables_of
from hil.records.atomic import replacing
from hil.records.layout import HEADER_KEY

_LONGEST_S = 9e9  # of time, that 64 bits of ns have room for
_Message = tuple[int, int, bytes]  # time, channel, JSON


def write_mcap(tables: Sequence[Exported], path: Path) -> None:
    """Write `tables` to `path`: a topic each, rows as JSON messages with a JSON schema, in the order of time.  What is
    not finite is left out of its message.  A message's time is the row's bench time in ns, from the first row of all
    where that is negative.  PlotJuggler needs the schemas and the summary.  Source: mcap.dev/spec.

    Raises InputError where the times are none that the format can hold.
    """
    from mcap.writer import Writer

    start_s = min((_first_s(table) for table in tables), default=0.0)
    zero_s = min(start_s, 0.0)
    with path.open("wb") as file:
        writer: Any = Writer(file)  # its methods are typed in part
        writer.start(profile="", library="gyrohil")
        streams = []
        for table in tables:
            schema = json.dumps(_schema(table)).encode()
            schema_id = writer.register_schema(name=f"gyrohil.{table.name}", encoding="jsonschema", data=schema)
            channel = writer.register_channel(topic=f"/{table.name}", message_encoding="json", schema_id=schema_id)
            streams.append(_messages(table, channel, zero_s))
        for time_ns, channel, data in heapq.merge(*streams, key=lambda message: message[0]):
            writer.add_message(channel_id=channel, log_time=time_ns, publish_time=time_ns, data=data)
        for table in tables:
            writer.add_metadata(f"gyrohil.{table.name}", _words(table, zero_s))
        writer.finish()


def _first_s(table: Exported) -> float:
    first: Columns | None = next(table.pieces(), None)
    return 0.0 if first is None or not len(first["t_s"]) else float(first["t_s"][0])


def _schema(table: Exported) -> dict[str, Any]:
    properties = {
        name: {"type": "number", "description": f"in {unit}" if unit else "a number"}
        for name, unit in table.units.items()
    }
    return {"title": table.name, "type": "object", "properties": properties}


def _messages(table: Exported, channel: int, zero_s: float) -> Iterator[_Message]:
    names = list(table.units)
    keys = [json.dumps(name) + ":" for name in names]
    for piece in table.pieces():
        for row in zip(*(piece[name].tolist() for name in names), strict=True):
            t_s = row[names.index("t_s")] - zero_s
            if not 0.0 <= t_s < _LONGEST_S:
                raise InputError(f"{table.name}: time {t_s:g} s has no place in an MCAP file; export to parquet")
            fields = (key + repr(value) for key, value in zip(keys, row, strict=True) if math.isfinite(value))
            yield round(1e9 * t_s), channel, ("{" + ",".join(fields) + "}").encode()


def _words(table: Exported, zero_s: float) -> Mapping[str, str]:
    about = {key: value if isinstance(value, str) else json.dumps(value) for key, value in table.about.items()}
    return {**about, "time_zero_s": repr(zero_s)}


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


Format = Literal["csv", "parquet", "mat", "mcap"]
FORMATS: tuple[Format, ...] = get_args(Format)
ONE_TABLE = ("csv", "parquet")
"""Formats that hold one table; the others hold several."""

_WRITERS: Mapping[str, Callable[[Sequence[Exported], Path], None]] = {
    "csv": lambda tables, path: write_csv(tables[0], path),
    "parquet": lambda tables, path: write_parquet(tables[0], path),
    "mat": write_mat,
    "mcap": write_mcap,
}


def format_for(target: Path, to: str | None) -> str:
    """The format asked for, by default the one that the name of `target` ends with. Raises InputError where the name
    says none, or another one.
    """
    ending = target.suffix.removeprefix(".").lower()
    if to is None:
        if ending not in FORMATS:
            raise InputError(f"{target}: its name ends with no format; known are {', '.join(FORMATS)}, or give --to")
        return ending
    if ending in FORMATS and to in FORMATS and ending != to:
        raise InputError(
            f"--to {to}: {target} is named as {ending}; name it {target.with_suffix(f'.{to}')}, or leave out --to"
        )
    return to


class Written(NamedTuple):
    """Rows of each table that was written; what the format does not carry of them, in words; which were interrupted."""

    rows: dict[str, int]
    left_out: tuple[str, ...]
    cut: tuple[str, ...]


def export(place: Path, target: Path, to: str, what: Sequence[str] = ()) -> Written:
    """Write what is named of the run folder or record file at `place` to `target`, whole or not at all.

    what: tables by name.  Without one, CSV and Parquet have the capture (of another file what is in it), MAT and MCAP
    all that was recorded and estimated.  Raises InputError for a format, a table or a file that cannot be used.
    """
    if to not in FORMATS:
        raise InputError(f"--to: {to} is no known format; known are {', '.join(FORMATS)}")
    names: list[What] = []
    for name in what:
        known = [one for one in WHAT if one == name]
        if not known:
            raise InputError(f"--what: {name} is not known; known are {', '.join(WHAT)}")
        names += known
    if to in ONE_TABLE:
        if len(names) > 1:
            raise InputError(f"--to: {to} holds one table, not {len(names)}; export one by one, or to mat or mcap")
        if not names and place.is_dir():
            names = ["capture"]
    tables = tables_of(place, names)
    with replacing(target) as temporary:
        _WRITERS[to](tables, temporary)
    left_out = tables[0].beside if to == "csv" else ()
    cut = tuple(f"{table.name}: {table.cut}" for table in tables if table.cut)
    return Written({table.name: table.rows for table in tables}, left_out, cut)
