"""``hil characterise``: the figures of a data sheet."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

import typer

import hil
from hil.characterising.options import LocalCharacteriseOptions
from hil.cli.options import RUNS, BenchOption, Json, Out, with_options
from hil.errors.ending import ExitCode

if TYPE_CHECKING:
    from hil.records.data_sheet import DataSheet

Records = Annotated[
    list[str],
    typer.Argument(
        metavar="RUN…", help="Runs, captures, `last`, or the LINK of a sensor, which is recorded first (stim300:PORT)."
    ),
]


@with_options(LocalCharacteriseOptions)
def characterise(
    records: Records,
    bench: BenchOption = None,
    out: Out = RUNS,
    json: Json = False,
    **options: Unpack[LocalCharacteriseOptions],
) -> None:
    """Determine the figures of a data sheet from records of one device.

    Terms of IEEE Std 1431 and 952, each with its 95 % interval, in the units of data sheets: bias and its scatter from
    run to run, scale factor, noise by the Allan deviation, bandwidth, delay, threshold, temperature; of a whole-angle
    run also the errors that depend on the angle. If the records do not determine a figure, the table has the reason.
    [limits] of the bench file may limit each. Exit code 0: every limit is kept; 1: one is not, or has no figure.

    Examples:

    \b
      hil characterise last
      hil characterise stim300:/dev/ttyUSB0 --duration 3600
      hil characterise monday tuesday wednesday --junit sheet.xml
      hil characterise last --truth truth.arrow --calibrate calibrations
      hil characterise table.arrow --bench rate-table-crs03
    """
    from hil.cli.options import capture_in
    from hil.cli.progress import watching
    from hil.cli.show import print_json
    from hil.library.sheets import is_sensor

    named = [record if is_sensor(record) else str(capture_in(Path(record))) for record in records]
    with watching("characterise") as watch:
        done = hil.characterise(named, bench, out=out, progress=watch, **options)
    sheet = done.sheet
    if json:
        print_json({"folder": str(done.path), **sheet.model_dump(mode="json", exclude={"seal"})})
    else:
        _print(sheet)
        print(done.path)
        if done.calibration is not None:
            print(f"kept  {done.calibration}; apply it by [device.calibration] angle_map")
    raise typer.Exit(ExitCode.GOOD if sheet.verdict == "good" else ExitCode.AGAINST)


def _print(sheet: "DataSheet") -> None:
    from hil.characterising.figures import HEAD, cells, headline
    from hil.cli.output import Output

    output = Output()
    output.table(HEAD, [cells(row) for row in sheet.rows])
    output.say()
    for remark in sheet.remarks:
        output.say(remark)
    _, word, sentence = headline(sheet)
    output.say(f"{word}  {sentence}")
