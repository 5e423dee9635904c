"""``hil record``: a sensor that speaks its maker's framing, recorded and checked."""

from typing import Annotated

import typer

import hil
from hil.cli.options import RUNS, Json, Note, Out, Report

PortLink = Annotated[str, typer.Argument(metavar="LINK", help="NAME:PATH[?baud=N], NAME being an adapter.")]
Seconds = Annotated[float, typer.Option("--duration", min=0.1, help="Seconds of the sensor's time.")]
RunName = Annotated[str | None, typer.Option("--name", help="Name of the run folder.  [default: the adapter's]")]


def record(
    link: PortLink,
    duration: Seconds = 10.0,
    out: Out = RUNS,
    name: RunName = None,
    note: Note = None,
    report: Report = True,
    json: Json = False,
) -> None:
    """Record a sensor that outputs rates and has no drive, and check the record.

    The verdict counts checksum errors, gaps in the sensor's own counter, its status bits and its latency. report.html
    has the rates and, with its Allan deviation, the noise of each axis: let the sensor stand still for that. Adapters
    for framings are entry points of the group hil.boards; stim300 (Sensonor, rate-only datagram) comes with the bench.

    Examples:

    \b
      hil record stim300:/dev/ttyUSB0 --duration 60
      hil record "stim300:/dev/ttyUSB0?baud=1843200" --note "on the rate table"
      hil record stim300:/dev/ttyUSB0 --duration 7200 --name still          long enough for the bias instability
      python -m device_emulator.stim300             an emulated one; prints where it can be reached
    """
    from hil.cli.progress import watching
    from hil.cli.show import finish, say

    try:
        with watching(name or link.partition(":")[0]) as watch:
            done = hil.record(
                link, duration_s=duration, name=name, note=note, report=report, out=out, progress=watch
            )  # fmt: skip
    except KeyboardInterrupt:
        say("the record was closed")
        raise
    finish(done.path, as_json=json)
