"""`hil import`: a record from elsewhere becomes a capture, whole or not at all.

One way leads from every kind of source to a capture: columns by name, time, rows that are lost, units, preparation.

Formats that other packages read: entry points of the group `hil.importers`, called as the files' names end.

    [project.entry-points."hil.importers"]
    mf4 = "my_package.mf4:columns"

The function takes a path and returns the file's columns, arrays (n,) by name; the rest of an import is the bench's:
what the columns are (a map), time, gaps, units.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.errors.input import loaded
from hil.importing.can_log import import_can_log, is_can_log
from hil.importing.channels import CHANNELS, COMPONENTS, SENSED
from hil.importing.demodulated import Carrier, carrier_of, on_one_carrier, require_streams
from hil.importing.mapping import RecordMap, read_map
from hil.importing.matlab import MatlabSource, is_matlab
from hil.importing.naming import Asked, asked_of
from hil.importing.parquet import ParquetSource, is_parquet
from hil.importing.preparation import prepared
from hil.importing.read_back import read_back, write_columns
from hil.importing.record_time import Remedies, numbered_rows, time_of
from hil.importing.request import ImportRequest
from hil.importing.source import ArraySource, Selection, Source, Table, Wanted
from hil.importing.suspicious import require_finite, require_measured, require_no_thousands
from hil.importing.text_source import TextSource
from hil.records.capture import Capture, Hold, import_layout, read_capture
from hil.wire.regular_file import what_instead

GROUP = "hil.importers"

Reader = Callable[[Path], Mapping[str, npt.ArrayLike]]


class PackagedSource(ArraySource):
    """The columns that another package reads from a file.  Raises InputError where it cannot."""

    def __init__(self, path: Path, reader: Reader) -> None:
        self.kind = f"a {path.suffix} file"
        try:
            super().__init__(dict(reader(path)), str(path))
        except Exception as error:  # whatever another package does wrong
            raise InputError(f"{path}: the package that reads {path.suffix} files cannot: {error}") from error

    def read(self, wanted: Sequence[Wanted], selection: Selection) -> Table:
        try:
            return super().read(wanted, selection)
        except InputError as error:
            told = str(error)
            raise InputError(told if told.startswith(self.called) else f"{self.called}: {told}") from None

    def place(self, row: int, column: str) -> str:
        return f"{self.called}: row {row + 1}: column {column}"


def endings() -> tuple[str, ...]:
    """How names of files end that packages read, with the dot."""
    return tuple(sorted({f".{one.name}" for one in entry_points(group=GROUP) if re.fullmatch("[a-z0-9]+", one.name)}))


def reader_of(path: Path) -> Reader | None:
    """Who reads files whose names end as this one's; None where no package does.

    Raises InputError for a package that cannot be loaded.
    """
    suffix = path.suffix.removeprefix(".")
    entry = next((one for one in entry_points(group=GROUP) if suffix and one.name == suffix), None)
    return None if entry is None else loaded(entry, str(path))


PLAIN = RecordMap(hold="zoh")
"""What is done without a map."""


class Imported(NamedTuple):
    """Where the capture is, and it read back; rows of the source that were gone through; columns of it that no channel
    is; what was done to the record."""

    path: Path
    capture: Capture
    of_rows: int
    left_out: tuple[str, ...]
    said: tuple[str, ...] = ()


def import_record(
    source: Path,
    target: Path,
    *,
    map_file: Path | None = None,
    hold: Hold | None = None,
    nonuniform: bool = False,
) -> Capture:
    """Turn the record `source` into the capture `target`, and return it read back; see `import_file`."""
    return import_file(ImportRequest(source, target, map_file, hold, nonuniform)).capture


def import_file(request: ImportRequest) -> Imported:
    """Turn a record (delimited text, plain or gzipped; MATLAB; Parquet; what a package reads) into a capture.

    Without a map, or without [columns] in it, names of columns are the interchange ones: t_s, vx_V, vy_V,
    ux_mps2, uy_mps2 (or _V, _N), and optionally rate_rad_s, temp_C; a single-axis record leaves out y. `hold` says what
    the drive did between samples: by default what the map says, or zoh. Time must increase, and be even unless
    `nonuniform`; samples that are missing leave a gap in `tick`, where nothing is known of the drive. A Parquet or
    MATLAB file that `hil export` wrote of a capture comes back as it was, without a map.

    Raises InputError with file, line or column, and the remedy; the target is then left as it was.
    """
    target, map_file, hold = request.target, request.map_file, request.hold
    _require_file(request.source)
    carrier = carrier_of(request.demodulated)
    if request.dbc is not None:
        capture, frames, said = import_can_log(request.source, target, request.dbc, request.reference)
        return Imported(target, capture, frames, (), said)
    if is_can_log(request.source):
        raise InputError(f"{request.source}: a log of CAN frames; say what they are by --dbc FILE")
    mapping = None if map_file is None else read_map(map_file)
    opened = open_source(request.source, mapping or PLAIN, map_file)
    may_be_own = mapping is None and hold is None and carrier is None
    if may_be_own and isinstance(opened, ParquetSource | MatlabSource) and (own := opened.exported):
        capture = read_back(opened, own, target)
        return Imported(target, capture, len(capture), ())
    if hold is None and mapping is None and isinstance(opened, ParquetSource):
        hold = opened.hold
    return import_from(
        opened, target, mapping, map_file=map_file, hold=hold, nonuniform=request.nonuniform, carrier=carrier
    )


def _require_file(path: Path) -> None:
    """Nothing else is opened: a pipe would wait for a writer.  Raises InputError."""
    try:
        kind = what_instead(path)
    except OSError:
        kind = None  # the source says why it cannot be read
    if kind is not None:
        raise InputError(f"{path}: is {kind}, and only files are imported; copy what it gives into one")


def is_arrow(source: Path) -> bool:
    """Whether the file is one, stream or file, by its first bytes."""
    try:
        with source.open("rb") as file:
            return file.read(6).startswith((b"\xff\xff\xff\xff", b"ARROW1"))
    except OSError:
        return False


def open_source(
    path: Path, mapping: RecordMap, map_file: Path | None
) -> ParquetSource | MatlabSource | PackagedSource | TextSource:
    """The file at `path` as a source. Raises InputError for a key of the map that has no meaning for its kind."""
    _require_file(path)
    if is_arrow(path):
        raise InputError(
            f"{path}: is an Arrow file; a capture needs no import, give it to `hil trace` or `hil replay` as it is"
        )
    if is_parquet(path):
        require_keys_act(mapping, ParquetSource.kind, str(path), map_file)
        return ParquetSource(path)
    if is_matlab(path):
        require_keys_act(mapping, MatlabSource.kind, str(path), map_file)
        return MatlabSource(path)
    if (reader := reader_of(path)) is not None:
        packaged = PackagedSource(path, reader)
        require_keys_act(mapping, packaged.kind, str(path), map_file)
        return packaged
    if path.suffix == ".parquet" and path.exists():
        raise InputError(f"{path}: no Parquet file, whatever its name says; export it anew, or name it as what it is")
    return TextSource(path, mapping)


def require_keys_act(mapping: RecordMap, kind: str, called: str, map_file: Path | None) -> None:
    """Refuse keys of texts beside what is none."""
    if keys := mapping.keys_of_text_given():
        raise InputError(f"{map_file}: {keys[0]}: acts on text only, and {called} is {kind}; leave it out")


def import_from(
    source: Source,
    target: Path,
    mapping: RecordMap | None,
    *,
    map_file: Path | None = None,
    hold: Hold | None = None,
    nonuniform: bool = False,
    remedies: Remedies | None = None,
    carrier: Carrier | None = None,
) -> Imported:
    given = mapping or PLAIN
    asked = asked_of(source, given, carrier)
    where = {_of_where(source, name): text for name, text in given.where.items()}
    wanted = [Wanted(part.at, part.called, part.is_time, part.source.thousands) for part in asked.parts]
    called = {_of_where(source, name): name for name in given.where}
    table = source.read(wanted, Selection(where, given.rows, given.missing or (), called))
    try:
        how = (hold or given.hold, nonuniform, remedies or Remedies())
        return _written(source, target, given, asked, table, how, carrier)
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{map_file or source.called}: {error}") from None


def _written(
    source: Source,
    target: Path,
    mapping: RecordMap,
    asked: Asked,
    table: Table,
    how: tuple[Hold, bool, Remedies],
    carrier: Carrier | None,
) -> Imported:
    hold, nonuniform, remedies = how
    stamps = time_of(source, asked, table, may_be_missing=bool(mapping.missing))
    channels: dict[str, npt.NDArray[np.float64]] = {}
    for part, values in zip(asked.parts, table.columns, strict=True):
        if not part.is_time:
            channels[part.channel] = values
    lost = np.zeros(table.rows.size, dtype=bool)
    for values in (*channels.values(), *(() if stamps is None else (stamps.elapsed,))):
        lost |= np.isnan(values)
    if lost.any() and np.count_nonzero(~lost) < 2:
        raise InputError(f"{source.called}: fewer than two rows hold a measurement; correct `missing`")
    if mapping.missing != ():
        for part, values in zip(asked.parts, table.columns, strict=True):
            if not part.is_time:
                require_measured(source, part, values, table.rows, mapping.missing, is_mapped=mapping is not PLAIN)
    if isinstance(source, TextSource) and mapping.decimal is None:
        for part, values in zip(asked.parts, table.columns, strict=True):
            if values.dtype.kind == "f" and part.source.thousands is None:
                require_no_thousands(source, part, values)
    for part in asked.parts:
        if not part.is_time:
            channels[part.channel] = part.source.in_its_unit(part.channel, channels[part.channel])
            require_finite(source, part, channels[part.channel], table, lost)
    segments = _segments(source, mapping, table, lost)
    said: list[str] = []
    time, t_s = numbered_rows(source, mapping, table, stamps, ~lost, nonuniform, remedies, said)
    kept = {name: values[~lost] for name, values in channels.items()}
    told_of_it: dict[str, Any] = {}
    if carrier is not None:
        require_streams(source, mapping, time)
        kept, told_of_it["carrier_Hz"] = on_one_carrier(source, kept, time, carrier)
    made = prepared({"t_s": t_s, **kept}, segments, hold, time, mapping)
    names = [name for name in (*CHANNELS, *SENSED.values(), *COMPONENTS) if name in made.channels]
    layout = import_layout(
        names,
        tick_rate_Hz=made.rate_Hz,
        uniform=time.uniform,
        hold=hold,
        segments=made.segments,
        steady=mapping.steady,
        sense_unit=mapping.sense_unit,
        told=told_of_it | made.told | ({"prepared": [*said, *made.told.get("prepared", ())]} if said else {}),
    )
    write_columns(target, layout, {name: made.channels[name] for name in names}, time.tick if time.lost else None)
    capture = read_capture(target)
    moved = None if stamps is None or mapping.steady else stamps.moved_from()
    told = () if moved is None else (f"t_s starts at 0, which is {moved} in {source.called}",)
    return Imported(target, capture, table.of, asked.left_out, (*told, *capture.prepared))


def _of_where(source: Source, name: str) -> int:
    try:
        return source.locate(name)
    except InputError as error:
        raise InputError(str(error).replace(f"no column {name!r};", f"no column {name!r} for `where`;")) from None


def _segments(
    source: Source, mapping: RecordMap, table: Table, lost: npt.NDArray[np.bool_]
) -> Mapping[str, tuple[int, int]]:
    """Segments counted from the first kept row; the map counts from the first row of the file."""
    first, stop = mapping.rows or (0, table.rows.size)
    last = first + table.rows.size
    ends = f"{source.called}: ends at data row {last}"
    if stop > last:
        raise InputError(f"{ends}, before the map's rows end ({stop}); correct `rows`")
    before = np.concatenate([[0], np.cumsum(~lost)])
    segments = {}
    for name, (start, end) in mapping.segments.items():
        if end > last:
            raise InputError(f"{ends}, before segment {name} ({end}); correct the map")
        segments[name] = (int(before[start - first]), int(before[end - first]))
    return segments
