"""``hil export``: a capture in a form other programs read."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from hil.cli.options import CaptureArgument, Json

Format = Annotated[Literal["csv", "parquet"], typer.Option("--to", help="Format of the file.")]
Target = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="File to write.  [default: the record's name and the format]"),
]


def export(capture: CaptureArgument, to: Format = "csv", out: Target = None, json: Json = False) -> None:
    """Write a capture, or the missing force of a trace, as CSV or Parquet.

    Values are in seconds, volts and the drive's unit; CSV reads back with `hil import`. Those of a missing force
    (force.arrow of a trace) are SI, per mass.

    Examples:

    \b
      hil export runs/first --to csv -o first.csv
      hil export silverbox.arrow --to parquet
      hil export runs/first-trace/force.arrow --to csv
    """
    from hil.cli.files import capture_in, fresh
    from hil.cli.show import print_json, say
    from hil.interchange.exporter import export_force, export_record
    from hil.records.force import is_force

    target = fresh(out or Path(f"{capture.resolve().stem}.{to}"))
    place = capture_in(capture)
    rows = export_force(place, target, to) if is_force(place) else export_record(place, target, to)
    if json:
        print_json({"file": str(target), "rows": rows})
    else:
        say(f"{target}: {rows} rows")
