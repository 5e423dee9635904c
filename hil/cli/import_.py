"""``hil import``: a record from elsewhere becomes a capture."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from hil.cli.options import Json, Replace

Source = Annotated[Path, typer.Argument(metavar="FILE", help="Delimited text, or gzipped; .mat; Parquet.")]
Target = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="Capture to write.  [default: the file's name with .arrow]"),
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
    """Turn a text, a MATLAB or a Parquet file into a capture that `hil replay` can run over.

    Columns are called t_s, vx_V, vy_V, ux_mps2, uy_mps2 (or _V, _N), and optionally rate_rad_s, temp_C;
    single-axis records leave out y. Files that look different come with a map.

    Examples:

    \b
      hil import ride.csv
      hil import SNLS80mV.csv.gz --map silverbox -o silverbox.arrow
      hil import DATA_EMPS.mat --map emps
    """
    from hil.bench.examples import find
    from hil.cli.files import fresh
    from hil.cli.show import print_json, say
    from hil.interchange.importer import import_file
    from hil.records.capture import missing

    out = out or named_after(csv)
    target = fresh(out, replace=replace, source=csv)
    map_file = None if map_name is None else find("map", map_name)
    imported = import_file(csv, target, map_file=map_file, hold=hold, nonuniform=nonuniform)
    capture = imported.capture
    if json:
        figures = {
            "capture": str(target),
            "samples": len(capture),
            "rows": imported.of_rows,
            "lost": capture.lost,
            "gaps": capture.gaps,
            "left_out": imported.left_out,
            "said": imported.said,
            "axes": capture.axes,
            "hold": capture.hold,
        }
        print_json({**figures, "tick_rate_Hz": capture.tick_rate_Hz, "segments": capture.segments})
    else:
        axes = "one axis" if capture.axes == 1 else "two axes"
        gone = f"; {missing(capture.lost, capture.gaps)}" if capture.lost else ""
        say(
            f"{target}: {len(capture)} samples of {imported.of_rows} rows at {capture.tick_rate_Hz:g} Hz, {axes}, "
            f"{capture.hold}{gone}"
        )
        for remark in imported.said:
            say(f"  {remark}")
        if imported.left_out:
            say(f"  left out, as no channel is called so: {', '.join(imported.left_out)}")


def named_after(source: Path) -> Path:
    """The capture's name where none is given: that of the file without what says its format."""
    name = source.name.removesuffix(".gz")
    ending = Path(name).suffix
    return Path((name.removesuffix(ending) if ending[1:].isalpha() else name) + ".arrow")
