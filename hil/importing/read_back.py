"""A capture that was exported comes back as it was: the table has its columns, the file's own note all else.

What a format cannot carry is told when it is written, by `not_carried`.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.importing.source import Selection, Source, Wanted
from hil.records.atomic import replacing
from hil.records.capture import Capture, RowFlag, read_capture
from hil.records.layout import BENCH, TICK, Column, Layout, block_rows_for
from hil.records.stream import BlockWriter

HEADER = "header"
"""Where the note of an exported capture has the header of the record, without what describes the columns."""

_OF_COLUMNS = ("kind", "version", "columns", "checksum")
_FLAGS = "flags"


class Exported(NamedTuple):
    """An export of a capture: its columns by name, with the source's name for each; units; the record's header."""

    names: Mapping[str, str]
    units: Mapping[str, str]
    header: Mapping[str, Any]


def header_of(capture: Capture) -> dict[str, Any]:
    """What is to be carried of a capture beside its columns, as JSON values."""
    return {key: value for key, value in capture.header.items() if key not in _OF_COLUMNS}


def exported_in(note: str | bytes, names: Mapping[str, str], units: Mapping[str, str]) -> Exported | None:
    """An export of a capture by the note that its file carries; None for any other file, and for one of before
    captures came back whole.
    """
    try:
        about = json.loads(note)
    except ValueError:
        return None
    header = about.get(HEADER) if isinstance(about, dict) and about.get("kind") == "capture" else None
    if not isinstance(header, dict) or not isinstance(header.get("tick_rate_Hz"), int | float):
        return None
    return Exported(names, units, header) if TICK.name in names else None


def read_back(source: Source, found: Exported, target: Path) -> Capture:
    """Write the capture that was exported to `target`, and return it read back.

    Raises InputError where a column cannot be read.
    """
    names = list(found.names)
    wanted = [Wanted(source.locate(found.names[name]), found.names[name]) for name in names]
    table = source.read(wanted, Selection({}, None, ()))
    values = dict(zip(names, table.columns, strict=True))
    columns = [TICK]
    for name in names:
        if name == _FLAGS:
            columns.append(Column(_FLAGS, "u1"))
        elif name != TICK.name:
            unit = name.rsplit("_", 1)[1] if name.startswith(("ux_", "uy_")) else found.units.get(name, "")
            columns.append(Column(name, "f8", unit, clock=BENCH if name == "t_s" else ""))
    layout = Layout("capture", tuple(columns), block_rows_for(float(found.header["tick_rate_Hz"])), found.header)
    ticks = values.pop(TICK.name)
    if not len(ticks) or np.any(np.diff(ticks.astype(np.int64)) <= 0):
        raise InputError(f"{source.called}: column tick does not increase; export the record anew")
    write_columns(target, layout, values, ticks.astype(np.int64))
    return read_capture(target)


_LOST: Mapping[str, Callable[[Capture], bool]] = {
    "segments": lambda capture: bool(capture.segments),
    "covariates": lambda capture: bool(capture.covariates),
    "the noise gain of its filter": lambda capture: capture.noise_gain != 1.0,
    "what was done to it at import": lambda capture: bool(capture.prepared),
    "that its rows are steady states": lambda capture: capture.steady,
    "the hold of its drive": lambda capture: capture.hold != "zoh",
    "the latency of its drive": lambda capture: capture.latency_ticks != 0,
    "who recorded it": lambda capture: capture.header.get("identity") is not None,
    "the flags of its rows": lambda capture: any(
        np.any(piece.flags & ~np.uint8(RowFlag.GAP_BEFORE)) for piece in capture.pieces()
    ),
    "the carrier of its demodulated streams": lambda capture: capture.carrier_Hz is not None,
    "the unit of what was sensed": lambda capture: capture.sense_unit != "V",
}


def not_carried(capture: Capture) -> tuple[str, ...]:
    """What a text with columns alone leaves out of this capture, in words."""
    return tuple(words for words, has in _LOST.items() if has(capture))


_PIECE_ROWS = 1 << 16


def write_columns(
    target: Path,
    layout: Layout,
    columns: Mapping[str, npt.NDArray[np.float64]],
    tick: npt.NDArray[np.int64] | None = None,
) -> None:
    """Write the capture `target`, whole or not at all: the columns of `layout`, (n,) each, at the numbers `tick` (n,),
    by default from 0 on without a gap.
    """
    count = len(next(iter(columns.values())))
    with replacing(target) as temporary, BlockWriter(temporary, layout) as writer:
        for start in range(0, count, _PIECE_ROWS):
            rows = np.empty(min(_PIECE_ROWS, count - start), layout.dtype)
            stop = start + rows.size
            rows["tick"] = np.arange(start, stop) if tick is None else tick[start:stop]
            for name, values in columns.items():
                rows[name] = values[start:stop]
            writer.push(rows)
        writer.close()
