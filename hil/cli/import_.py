"""``hil import``: a text record from elsewhere becomes a capture."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from hil.cli.options import Json, Replace

Source = Annotated[Path, typer.Argument(metavar="CSV", help="Text with a header line, or gzipped; .mat; .parquet.")]
Target = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="Capture to write.  [default: the CSV's name with .arrow]"),
]
Map = Annotated[
    str | None,
    typer.Option("--map", "-m", help="Map of columns, units and rate for other layouts; a file or an example."),
]
Hold = Annotated[
    Literal["zoh", "foh", "bandlimited"] | None,
    typer.Option("--hold", help="What the drive did between samples.  [default: the map's, or zoh]"),
]
Nonuniform = Annotated[
    bool,
    typer.Option("--nonuniform", help="Accept uneven time, each step with its length, and gaps."),
]


def import_(
    csv: Source,
    out: Target = None,
    map_name: Map = None,
    hold: Hold = None,
    nonuniform: Nonuniform = False,
    replace: Replace = False,
    json: Json = False,
) -> None:
    """Turn a CSV file into a capture that `hil replay` can run over.

    The header is t_s, vx_V, vy_V, ux_mps2, uy_mps2 (or _V, _N), and optionally rate_rad_s, temp_C;
    single-axis records leave out y. Files that look different come with a map, MATLAB files always.

    Examples:

    \b
      hil import ride.csv
      hil import SNLS80mV.csv.gz --map silverbox -o silverbox.arrow
      hil import DATA_EMPS.mat --map emps
    """
    from hil.cli.files import fresh
    from hil.cli.show import print_json, say
    from hil.examples import find
    from hil.interchange.importer import import_record
    from hil.records.capture import missing

    out = out or Path(csv.name.removesuffix(".gz").removesuffix(".csv") + ".arrow")
    target = fresh(out, replace=replace, source=csv)
    map_file = None if map_name is None else find("map", map_name)
    capture = import_record(csv, target, map_file=map_file, hold=hold, nonuniform=nonuniform)
    if json:
        figures = {
            "capture": str(target),
            "samples": len(capture),
            "axes": capture.axes,
            "hold": capture.hold,
            "lost": capture.lost,
            "gaps": capture.gaps,
        }
        print_json({**figures, "tick_rate_Hz": capture.tick_rate_Hz, "segments": capture.segments})
    else:
        axes = "one axis" if capture.axes == 1 else "two axes"
        gone = f"; {missing(capture.lost, capture.gaps)}" if capture.lost else ""
        say(f"{target}: {len(capture)} samples at {capture.tick_rate_Hz:g} Hz, {axes}, {capture.hold}{gone}")
