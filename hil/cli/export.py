"""``hil export``: what a run recorded and estimated, in a form other programs read."""

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import CaptureArgument, Json, Replace

Format = Annotated[
    str | None,
    typer.Option("--to", help="Format: csv, parquet, mat or mcap.  [default: by the name of --out, or csv]"),
]
What = Annotated[
    list[str] | None,
    typer.Option(
        "--what",
        help="Table: capture, estimates, angle, rate, innovation or force; of mat and mcap repeatable.  "
        "[default: capture; of mat and mcap all there is]",
    ),
]
Target = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="File to write.  [default: the record's name, the table and the format]"),
]


def export(
    capture: CaptureArgument,
    to: Format = None,
    what: What = None,
    out: Target = None,
    replace: Replace = False,
    json: Json = False,
) -> None:
    """Write a run's capture, estimates, angle, rate or innovation as CSV, Parquet, MAT or MCAP.

    Values are SI, with uncertainties. CSV and Parquet have one table; MAT has a struct for each table, MCAP a topic
    (for PlotJuggler and Foxglove). `hil import` reads a capture in Parquet or MAT back without loss. CSV loses some of
    it, and a message says what. Of a trace, the missing force is exported.

    Examples:

    \b
      hil export runs/first --to csv -o first.csv
      hil export last --what angle --to parquet
      hil export last --to mat -o first.mat
      hil export last -o first.mcap
      hil export silverbox.arrow --to parquet
      hil export last-trace --what force --to csv
    """
    from hil.cli.options import run_folder
    from hil.cli.show import print_json, say
    from hil.exporting.exporter import export as write
    from hil.exporting.exporter import format_for
    from hil.records.kind import fresh

    place = run_folder(capture).resolve()
    to = to or "csv" if out is None else format_for(out, to)
    named = "".join(f"-{one}" for one in what or ())
    out = out or Path(f"{place.name if place.is_dir() else place.stem}{named}.{to}")
    target = fresh(out, replace=replace, source=place)
    written = write(place, target, to, what or ())
    rows = written.rows
    if json:
        left_out = list(written.left_out)
        also = {"left_out": left_out, "cut": list(written.cut)}
        print_json({"file": str(target), "rows": sum(rows.values()), "tables": rows} | also)
    else:
        told = ", ".join(f"{count} rows of {name}" for name, count in rows.items())
        say(f"{target}: {told}")
        for cut in written.cut:
            say(f"  {cut}")
        if written.left_out:
            say(f"  a CSV does not contain: {', '.join(written.left_out)}; Parquet and MAT do")
