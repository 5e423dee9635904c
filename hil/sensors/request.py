"""A recording of a sensor as it is asked for: for every caller alike."""

import math
from dataclasses import dataclass
from numbers import Real

from hil.errors import InputError
from hil.errors.input import path_of, require
from hil.options import chosen
from hil.records.atomic import require_name
from hil.sensors.options import LocalRecordOptions, RecordOptions
from hil.sensors.port import UNKNOWN, Port, find_port


@dataclass(frozen=True)
class RecordRequest:
    """The sensor and its port, the link by its name, and what else is asked, see `RecordOptions`; an empty name is that
    of the sensor, once it is recognised."""

    port: Port
    link: str
    duration_s: float
    name: str
    note: str | None = None
    report: bool = True


def request_of(link: str, options: RecordOptions) -> RecordRequest:
    """Put together what is asked; link: `NAME:PATH[?baud=N]`, NAME being that of an adapter.  Raises InputError."""
    given = chosen(LocalRecordOptions, options)
    require("link", link, str, "a text such as stim300:/dev/ttyUSB0")
    require("duration_s", given["duration_s"], Real, "a number of seconds")
    if not 0.0 < given["duration_s"] < math.inf:
        raise InputError(f"--duration: {given['duration_s']:g} s; give a time above 0")
    dbc = given.pop("dbc")
    port = find_port(link, None if dbc is None else path_of("dbc", dbc))
    scheme = link.partition(":")[0]
    name = given["name"] or getattr(port.adapter, "name", "" if scheme in UNKNOWN else scheme)
    if name:
        require_name(name)
    return RecordRequest(port, link, **{**given, "name": name})
