"""``hil import``: a record from elsewhere becomes a capture."""

from pathlib import Path
from typing import Annotated, Unpack

import typer

import hil
from hil.cli.options import Json, with_options
from hil.importing.options import LocalImportOptions

Source = Annotated[Path, typer.Argument(metavar="FILE", help="Delimited text, or gzipped; .mat; Parquet.")]


@with_options(LocalImportOptions)
def import_(source: Source, json: Json = False, **options: Unpack[LocalImportOptions]) -> None:
    """Turn a text, a MATLAB or a Parquet file into a capture that `hil replay` can run over.

    Columns are called t_s, vx_V, vy_V, ux_mps2, uy_mps2 (or _V, _N), and optionally rate_rad_s, temp_C;
    single-axis records leave out y. Files that look different come with a map.

    Examples:

    \b
      hil import ride.csv
      hil import SNLS80mV.csv.gz --map silverbox -o silverbox.arrow
      hil import DATA_EMPS.mat --map emps
      hil import drive.blf --dbc car.dbc --reference rate_z       a log of CAN frames; also candump, ASC, MF4
    """
    from hil.cli.show import print_json, say
    from hil.records.capture import missing

    imported = hil.import_record(source, **options)
    target = imported.path
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
        axes = ("rates", "one axis", "two axes")[capture.axes]
        gone = f"; {missing(capture.lost, capture.gaps)}" if capture.lost else ""
        say(
            f"{target}: {len(capture)} samples of {imported.of_rows} rows at {capture.tick_rate_Hz:g} Hz, {axes}, "
            f"{capture.hold}{gone}"
        )
        for remark in imported.said:
            say(f"  {remark}")
        if imported.left_out:
            say(f"  left out, as no channel is called so: {', '.join(imported.left_out)}")
