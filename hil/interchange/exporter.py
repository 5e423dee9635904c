"""`hil export`: a capture as interchange CSV or Parquet, in SI units."""

import json
from pathlib import Path
from typing import Any, BinaryIO, Literal, get_args

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.records.atomic import replacing
from hil.records.capture import Capture, RowFlag, read_capture
from hil.records.layout import HEADER_KEY
from hil.records.rates import rates_rad_s

Format = Literal["csv", "parquet"]
FORMATS: tuple[Format, ...] = get_args(Format)


def export_record(capture: Path, target: Path, to: Format) -> int:
    """Write the capture at `capture` to `target`, whole or not at all; returns the number of rows.

    CSV carries the interchange columns and reads back with `hil import`; Parquet adds `tick` and `flags`, and
    keeps hold, rate and segments in its metadata. Raises InputError for a format that is not known.
    """
    if to not in FORMATS:
        raise InputError(f"--to {to}: not a known format; known are {', '.join(FORMATS)}")
    record = read_capture(capture)
    with replacing(target) as temporary:
        if to == "csv":
            with temporary.open("wb") as file:
                _write_csv(record, file)
        else:
            _write_parquet(record, temporary)
    return len(record)


def export_force(table: Path, target: Path, to: Format) -> int:
    """Write the missing force at `table` (force.arrow of a trace) to `target`, whole or not at all; returns its rows.

    Raises InputError for a format that is not known, and for a file that is no such table.
    """
    if to not in FORMATS:
        raise InputError(f"--to {to}: not a known format; known are {', '.join(FORMATS)}")
    from hil.records.force import load_force

    force = load_force(table)
    with replacing(target) as temporary:
        if to == "csv":
            import pyarrow.csv as pa_csv

            pa_csv.write_csv(force, temporary)
        else:
            import pyarrow.parquet as pq

            pq.write_table(force, temporary)
    return int(force.num_rows)


def channels(capture: Capture) -> dict[str, npt.NDArray[Any]]:
    """The interchange columns of a capture, in SI units and in the order of the file."""
    axes = "xy"[: capture.axes]
    columns: dict[str, npt.NDArray[Any]] = {"t_s": capture.t_s}
    suffix = "V" if capture.sense_unit == "V" else "sensed"  # in the sensor's own unit, which its header says
    columns |= {f"v{axis}_{suffix}": capture.sense_V[:, index] for index, axis in enumerate(axes)}
    if capture.has_drive:
        columns |= {f"u{axis}_{capture.drive_unit}": capture.drive[:, index] for index, axis in enumerate(axes)}
    columns |= {f"rate_{axis}_rad_s": values for axis, values in rates_rad_s(capture).items()}
    for name, values in (("rate_rad_s", capture.rate_rad_s), ("temp_C", capture.temp_C)):
        if values is not None:
            columns[name] = values
    return columns


def _write_csv(capture: Capture, file: BinaryIO) -> None:
    import pyarrow as pa
    import pyarrow.csv as pa_csv

    options = pa_csv.WriteOptions(include_header=False)
    file.write((",".join(channels(capture.part(0, 0))) + "\n").encode())
    for piece in capture.pieces():
        pa_csv.write_csv(pa.table(channels(piece)), file, options)


def _write_parquet(capture: Capture, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    about = {
        "kind": "capture",
        "tick_rate_Hz": capture.tick_rate_Hz,
        "hold": capture.hold,
        "latency_ticks": capture.latency_ticks,
        "segments": capture.segments,
        "sense_unit": capture.sense_unit,
        "covariates": capture.covariates,
        "prepared": capture.prepared,
        "complete": capture.complete,
        "identity": capture.header.get("identity"),
    }
    schema = pa.table(_rows(capture.part(0, 0))).schema.with_metadata({HEADER_KEY: json.dumps(about)})
    before = None
    with pq.ParquetWriter(path, schema) as writer:
        for piece in capture.pieces():
            columns = _rows(piece)
            if before is not None and columns["tick"][0] != before + 1:  # the gap that lies between two pieces
                columns["flags"][0] |= np.uint8(RowFlag.GAP_BEFORE)
            before = columns["tick"][-1]
            writer.write_table(pa.table(columns, schema))


def _rows(capture: Capture) -> dict[str, npt.NDArray[Any]]:
    return {"tick": capture.tick, **channels(capture), "flags": capture.flags}
