"""Options and arguments that several verbs share."""

import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, get_args

import typer
from annotated_types import Ge, Le

from hil.errors import InputError
from hil.library.keywords import with_keywords
from hil.options import Keyword, keywords_of

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


def with_options(options: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator for a verb that takes them as `**options`; `duration_s` is `--duration` there."""

    def around(verb: Callable[..., None]) -> Callable[..., None]:
        verb.__signature__ = with_keywords(verb, options, _option)  # type: ignore[attr-defined]
        verb.__annotations__ = {}  # where typer looks first
        return verb

    return around


def _option(one: Keyword) -> Any:
    """Whole numbers are held in their limits by the command line, the rest by the bench, in its words."""
    least = next((limit.ge for limit in one.limits if isinstance(limit, Ge)), None)
    most = next((limit.le for limit in one.limits if isinstance(limit, Le)), None)
    more: dict[str, Any] = {"min": least, "max": most} if int in get_args(one.type) else {}
    more |= {"metavar": "NAME"} if one.is_names else {}
    kind = list[str] | None if one.is_names else Path | None if Path in get_args(one.type) else one.type
    flag = one.called.name.replace("_", "-")
    is_switch = bool in (one.type, *get_args(one.type)) and one.default is not False
    names = [f"--{flag}/--no-{flag}" if is_switch else f"--{flag}"]
    names += [f"-{one.called.letter}"] if one.called.letter else []
    return Annotated[kind, typer.Option(*names, help=one.help, **more)]


def as_words(options: type, given: Mapping[str, Any]) -> list[str]:
    """The same on a command line, for another process of the bench."""
    words: list[str] = []
    for one in keywords_of(options):
        if (value := given.get(one.name)) not in (None, False):
            words += [f"--{one.called.name.replace('_', '-')}", *([] if value is True else [str(value)])]
    return words


def run_folder(place: Path) -> Path:
    """The folder meant by ``place``: `last` is the newest run in runs/, `last-trace` the newest trace, unless a file or
    folder has that name.
    """
    from hil.records.runs import named

    return named(place)


def capture_in(place: Path) -> Path:
    """The capture meant by ``place``: a run folder stands for the one in it, `last` for that of the newest run."""
    place = run_folder(place)
    return place / "capture.arrow" if place.is_dir() else place


def bench_file(given: str | None, capture: Path, verb: str) -> Path:
    """The bench file that is ``given``, or else the one by which the run was made that ``capture`` belongs to.

    Raises InputError where a record has none of its own, with the command that names one.
    """
    from hil.bench.examples import find
    from hil.records.runfolder import bench_of_record

    if given is not None:
        return find("bench", given)
    if not capture.exists():
        raise InputError(f"{capture}: no such record; give a capture.arrow, or the run folder it is in")
    if (own := bench_of_record(capture)) is None:
        command = f"hil {verb} {shlex.quote(str(capture))} --bench FILE"
        raise InputError(f"{capture}: no bench file belongs to it; name one: {command}")
    return own
