"""Tables as MCAP, a topic each, rows as JSON messages with a JSON schema: what PlotJuggler and Foxglove open.

A message's time is the row's bench time in ns, from the first row of all where that is negative. Source: the MCAP
format specification (mcap.dev/spec), written by the `mcap` package; PlotJuggler needs schemas and a summary, which are
there.
"""

import heapq
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hil.errors import InputError
from hil.exporting.exported import Columns, Exported

_LONGEST_S = 9e9  # of time, that 64 bits of ns have room for
_Message = tuple[int, int, bytes]  # time, channel, JSON


def write_mcap(tables: Sequence[Exported], path: Path) -> None:
    """Write `tables` to `path`, messages in the order of time.  What is not finite is left out of its message.

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
