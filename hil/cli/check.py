"""``hil check``: are records what was written?"""

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import Json
from hil.errors.ending import ExitCode

Place = Annotated[
    Path,
    typer.Argument(
        metavar="RUN", help="Run folder, one of its .arrow files, the name of a run, or `last`, the newest."
    ),
]
Repair = Annotated[bool, typer.Option("--repair", help="Keep every whole block, in a new file or folder.")]
Target = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="The new file or folder.  [default: the old one's name and 'repaired']"),
]


def check(place: Place, repair: Repair = False, out: Target = None, json: Json = False) -> None:
    """Check the checksum of every block of a run's records, that they are complete, and that they agree.

    Exit code 0: all whole; 1: a block is damaged, a record was interrupted, or files do not belong together; 2: no
    record. --repair leaves the original as it is; what it keeps reads as an interrupted record.

    Examples:

    \b
      hil check last
      hil check runs/first/capture.arrow --json
      hil check runs/first --repair
      hil check capture.arrow --repair -o kept.arrow
    """
    from hil.cli.options import run_folder
    from hil.cli.show import print_json, say
    from hil.errors import InputError, printable
    from hil.records.check import check as check_records
    from hil.records.check import repair as repair_records

    if out is not None and not repair:
        raise InputError("--out: only with --repair")
    place = run_folder(place)
    found = check_records(place)
    whole = all(entry.whole for entry in found)
    made = repair_records(place, out) if repair else None
    if json:
        files = [entry.figures() for entry in found]
        print_json({"whole": whole, "files": files, "repaired": None if made is None else str(made)})
    else:
        for entry in found:
            length = f"{entry.rows} rows, {entry.seconds:.3f} s" if entry.rows else ""
            lines = [*entry.problems, *entry.remarks] or ["whole"]
            for line in lines:
                print(printable(f"{entry.name:<18}{length:<32}{line}").rstrip())
        if made is not None:
            say(f"{made}: every whole block")
    raise typer.Exit(ExitCode.GOOD if whole else ExitCode.AGAINST)
