"""``hil record``: a sensor that speaks its maker's framing, recorded and checked."""

from typing import Annotated, Unpack

import typer

import hil
from hil.cli.options import RUNS, Json, Out, with_options
from hil.sensors.options import LocalRecordOptions

_LINK = "NAME:PLACE[?baud=N], NAME being serial, can, replay, iio or a sensor's."
PortLink = Annotated[str, typer.Argument(metavar="LINK", help=_LINK)]


@with_options(LocalRecordOptions)
def record(link: PortLink, out: Out = RUNS, json: Json = False, **options: Unpack[LocalRecordOptions]) -> None:
    """Record a sensor that outputs rates and has no drive, and check the record.

    The verdict counts checksum errors, gaps in the sensor's own counter, its status bits and its latency. report.html
    has the rates and, with its Allan deviation, the noise of each axis: let the sensor stand still for that. serial,
    can and replay find out which sensor speaks; docs/reference/gyros.md has the known ones, others are entry points of
    the group hil.boards, or on CAN a DBC.

    Examples:

    \b
      hil record serial:/dev/ttyUSB0 --duration 60
      hil record can:can0 --dbc my_gyro.dbc
      hil record "stim300:/dev/ttyUSB0?baud=1843200" --note "on the rate table"
      hil record stim300:/dev/ttyUSB0 --duration 7200 --name still          long enough for the bias instability
      python -m device_emulator.gyros xsens         an emulated one; prints where it can be reached
    """
    from hil.cli.progress import watching
    from hil.cli.show import finish, say

    try:
        with watching(options.get("name") or link.partition(":")[0]) as watch:
            done = hil.record(link, out=out, progress=watch, **options)
    except KeyboardInterrupt:
        say("the record was closed")
        raise
    finish(done.path, as_json=json)
