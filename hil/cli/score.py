"""``hil score``: estimates beside the truth."""

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import Json

Run = Annotated[Path, typer.Argument(metavar="RUN", help="Run folder, the name of a run, or `last`, the newest.")]
TruthFile = Annotated[Path, typer.Option("--truth", help="File the emulated board wrote (hil run --truth).")]


def score(run: Run, truth: TruthFile, json: Json = False) -> None:
    """Compare a run with the truth of its emulated board.

    Adds the figures to result.json and writes the report anew.

    Examples:

    \b
      hil run s-slow --truth truth.arrow --replace
      hil score last --truth truth.arrow
    """
    from hil.cli.options import run_folder
    from hil.cli.show import finish, say
    from hil.report.page import write_report
    from hil.scoring.score import score as compare

    run = run_folder(run)
    told = f"{run}: nothing of it was changed"
    try:
        compare(run, truth)
        told = f"{run}: the figures are in result.json, the report was not made again"
        write_report(run, truth)
    except KeyboardInterrupt:
        say(told)
        raise
    finish(run, as_json=json)
