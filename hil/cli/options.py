"""Options and arguments that several verbs share."""

from pathlib import Path
from typing import Annotated

import typer

BenchArgument = Annotated[str, typer.Argument(metavar="BENCH", help="Bench file, or the name of an example (s-slow).")]
BenchOption = Annotated[
    str | None,
    typer.Option(
        "--bench",
        "-b",
        help="Bench file, or the name of an example (silverbox).  [default: the one by which the run was made]",
    ),
]
CaptureArgument = Annotated[
    Path,
    typer.Argument(
        metavar="CAPTURE", help="A capture.arrow, the run folder it is in, the name of a run, or `last`, the newest."
    ),
]
Duration = Annotated[float | None, typer.Option("--duration", help="Length of the run in bench seconds.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object, alone on standard output.")]
Link = Annotated[
    str | None,
    typer.Option(
        "--link",
        "-l",
        help="Where the board is: serial:PORT, can:NAME, udp:GROUP:PORT, pty:SCENARIO or inproc:SCENARIO.",
    ),
]
Name = Annotated[str | None, typer.Option("--name", help="Last part of the run folder's name.  [default: the bench's]")]
Out = Annotated[Path, typer.Option("--out", "-o", help="Folder in which the run folder TIME-NAME is made.")]
Report = Annotated[
    bool, typer.Option("--report/--no-report", help="Draw report.html; leave it out to save time on many records.")
]
Replace = Annotated[bool, typer.Option("--replace", help="Overwrite an existing file.")]
Seed = Annotated[
    int | None,
    typer.Option("--seed", min=0, max=2**63 - 1, help="Seed of the dither and of an emulated board's noise."),
]
Truth = Annotated[
    Path | None,
    typer.Option("--truth", help="File into which an emulated board writes its true states, for `hil score`."),
]

RUNS = Path("runs")
