"""`hil import`: a record from elsewhere becomes a capture, whole or not at all."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.interchange.channels import CHANNELS, SENSED, fault_in
from hil.interchange.columns import write_columns
from hil.interchange.mapping import RecordMap, delimiter_meant, locate, locate_where, read_map
from hil.interchange.matlab import is_matlab, read_vectors
from hil.interchange.parquet import is_parquet, read_parquet
from hil.interchange.preparation import prepared
from hil.interchange.table import Table, read_columns, read_header
from hil.interchange.uniformity import Numbered, first_not_increasing, numbered, odd_step, spacing
from hil.records.capture import Capture, Hold, import_layout, read_capture


class _Record(NamedTuple):
    """Channels in SI by name, still with the lines they stood on, and what the map said of them."""

    channels: dict[str, npt.NDArray[np.float64]]
    lines: npt.NDArray[np.int64]
    rate_Hz: float | None
    hold: Hold
    segments: Mapping[str, tuple[int, int]]
    steady: bool = False
    mapping: RecordMap | None = None


def import_record(
    source: Path,
    target: Path,
    *,
    map_file: Path | None = None,
    hold: Hold | None = None,
    nonuniform: bool = False,
) -> Capture:
    """Turn the record `source` (CSV, plain or gzipped; MATLAB with a map; Parquet as `hil export` has it) into the
    capture `target`, and return it read back.

    Without `map_file` the header must be the interchange one: t_s, vx_V, vy_V, ux_mps2, uy_mps2 (or _V, _N),
    and optionally rate_rad_s, temp_C; a single-axis record leaves out y. `hold` says what the drive did
    between samples: by default what the map says, or zoh. Time must increase, and be even unless `nonuniform`; samples
    that are missing then leave a gap in `tick`, where nothing is known of the drive.

    Raises InputError with file, line or column, and the remedy; `target` is then left as it was.
    """
    record = _read_plain(source) if map_file is None else _read_mapped(source, read_map(map_file))
    time = _time_base(source, record, nonuniform)
    if hold is not None:
        record = record._replace(hold=hold)
    channels = dict(record.channels)
    if "t_s" not in channels:
        channels["t_s"] = time.tick / time.rate_Hz
    record = record._replace(channels=channels)
    try:
        made = prepared(record.channels, record.segments, record.hold, time, record.mapping)
    except ValueError as error:
        raise InputError(f"{source if map_file is None else map_file}: {error}") from None
    channels = made.channels
    names = [name for name in (*CHANNELS, *SENSED.values()) if name in channels]
    layout = import_layout(
        names,
        tick_rate_Hz=made.rate_Hz,
        uniform=time.uniform,
        hold=record.hold,
        segments=made.segments,
        steady=record.steady,
        sense_unit="V" if record.mapping is None else record.mapping.sense_unit,
        told=made.told,
    )
    tick = time.tick if time.lost else None
    write_columns(target, layout, {name: channels[name] for name in names}, tick)
    return read_capture(target)


def _read_plain(source: Path) -> _Record:
    if is_parquet(source):
        return _read_parquet(source)
    if is_matlab(source):
        raise InputError(f"{source}: a MATLAB file; give a --map that says which variable is which channel")
    if source.suffix == ".parquet":
        raise InputError(f"{source}: no Parquet file, whatever its name says; export it anew, or name it as what it is")
    header = read_header(source)
    if (mark := delimiter_meant(header, ",")) is not None:
        shown = "\\t" if mark == "\t" else mark
        raise InputError(f'{source}:1: the line is one cell; give a --map with delimiter = "{shown}"')
    fault = fault_in(header, needs_time=True)
    if fault:
        raise InputError(f"{source}:1: {fault}")
    table = read_columns(source, range(len(header)), header)
    channels = {name: table.values[:, index] for index, name in enumerate(header)}
    return _Record(channels, table.lines, None, "zoh", {})


def _read_parquet(source: Path) -> _Record:
    names, values, hold = read_parquet(source)
    fault = fault_in(names, needs_time=True)
    if fault:
        raise InputError(f"{source}: {fault}")
    channels = dict(zip(names, values.T, strict=True))
    return _Record(channels, np.arange(1, len(values) + 1), None, hold, {})


def _read_mapped(source: Path, mapping: RecordMap) -> _Record:
    if is_parquet(source):
        raise InputError(f"{source}: a map is for CSV and MATLAB files; name the columns of Parquet as hil export does")
    sources = mapping.columns.given()
    if is_matlab(source):
        table = read_vectors(source, [str(entry.column) for entry in sources.values()], mapping.rows)
    else:
        header = read_header(source, mapping.delimiter, mapping.skip_lines)
        table = read_columns(
            source,
            locate(mapping, header, source),
            [f"{entry.column} ({channel})" for channel, entry in sources.items()],
            delimiter=mapping.delimiter,
            skip_lines=mapping.skip_lines,
            header=mapping.header,
            rows=mapping.rows,
            where=locate_where(mapping, header, source),
        )
    channels: dict[str, npt.NDArray[np.float64]] = {}
    for index, (channel, entry) in enumerate(sources.items()):
        factor, addition = entry.factor_and_addition(channel)
        channels[channel] = factor * table.values[:, index] + addition
    segments = _segments(source, mapping, table)
    rate_Hz = 1.0 if mapping.steady else mapping.sampling_rate_Hz
    return _Record(channels, table.lines, rate_Hz, mapping.hold, segments, mapping.steady, mapping)


def _segments(source: Path, mapping: RecordMap, table: Table) -> dict[str, tuple[int, int]]:
    """Segments counted from the first kept row; the map counts from the first row of the file."""
    first, stop = mapping.rows or (0, table.lines.size)
    last = first + table.lines.size
    if stop > last:
        raise InputError(f"{source}: ends at data row {last}, before the map's rows end ({stop}); correct `rows`")
    for name, (_, end) in mapping.segments.items():
        if end > last:
            raise InputError(f"{source}: ends at data row {last}, before segment {name} ({end}); correct the map")
    return {name: (start - first, end - first) for name, (start, end) in mapping.segments.items()}


def _time_base(source: Path, record: _Record, nonuniform: bool) -> Numbered:
    """Sampling rate, whether samples are evenly spaced, and the number of each among those that are missing."""
    rows = record.lines.size
    if rows < 2:
        raise InputError(f"{source}: one row only; a record needs at least two")
    if record.rate_Hz is not None:
        return Numbered(np.arange(rows), record.rate_Hz, True)
    t_s = record.channels["t_s"]
    row = first_not_increasing(t_s)
    if row is not None:
        later, earlier = t_s[row], t_s[row - 1]
        raise InputError(
            f"{source}:{record.lines[row]}: column t_s: {later:.9g} s is not later than {earlier:.9g} s "
            "on the row before; sort or mend the time column"
        )
    _, off = spacing(t_s)
    time = numbered(t_s)
    if off is not None and not nonuniform:
        remedy = f"{time.missing()}; give --nonuniform to keep them as gaps" if time.lost else None
        raise InputError(
            f"{source}:{record.lines[off]}: column t_s: {odd_step(t_s, off)}; "
            f"{remedy or 'give --nonuniform if the record is meant so'}"
        )
    if time.mostly_lost:
        raise InputError(
            f"{source}: column t_s: {time.missing()}, more than there are; import what lies before and behind by itself"
        )
    return time
