"""``hil trace``: from the residual of a record to the effect that the model lacks."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

import typer

from hil.cli.options import RUNS, BenchOption, CaptureArgument, Json, Link, Out, Replace, with_options
from hil.tracing.options import TraceOptions

if TYPE_CHECKING:
    from hil.bench import Bench
    from hil.tracing.request import Traced, TraceRequest
    from hil.tracing.separate import Asked

Add = Annotated[
    Path | None,
    typer.Option(
        "--add",
        help="Bench file to write: a copy of the given one with the effect found, or the form of the missing force.",
    ),
]
Live = Annotated[
    bool,
    typer.Option("--live", help="Make the experiment that separates an ambiguity group, on the board at --link."),
]
More = Annotated[
    list[Path] | None,
    typer.Argument(metavar="[CAPTURE …]", help="Further records of the same device, to be traced together with it."),
]
Arm = Annotated[bool, typer.Option("--arm", help="Consent to arming the board for it; emulated ones need none.")]


@with_options(TraceOptions)
def trace(
    capture: CaptureArgument,
    bench: BenchOption = None,
    more: More = None,
    out: Out = RUNS,
    add: Add = None,
    replace: Replace = False,
    live: Live = False,
    link: Link = None,
    arm: Arm = False,
    json: Json = False,
    **options: Unpack[TraceOptions],
) -> None:
    """Find the effect that the model lacks.

    Runs the observer of the bench file over the record and tests its residual. Fits the effects of the catalogue, and
    those that the bench file or a package declares, on one part of the record, and tests them on the rest. Several
    records are traced together; each has its own initial conditions, and whole records are held out. Writes
    diagnosis.json and report.html. Exit code 0: the model lacks nothing, or the missing effect was found; 1: the model
    lacks something that no effect explains completely. If a residual is left, the missing force is estimated: the
    report shows it and proposes a form, and force.arrow has it sample by sample (hil export converts it to CSV).

    Examples:

    \b
      hil trace last
      hil trace runs/first --bench s-undeclared --add better.bench.toml --replace
      hil trace runs/first --bench my.bench.toml --live --link serial:/dev/ttyACM0 --arm
      hil trace silverbox.arrow --bench silverbox --json
      hil trace load-0.arrow load-1.arrow load-2.arrow load-3.arrow --bench beam.bench.toml --covariate load_kg
      hil trace runs/first --bench s-undeclared --missing-force
    """
    from hil.cli.consent import prepare
    from hil.cli.options import bench_file, capture_in
    from hil.cli.progress import watching
    from hil.cli.show_diagnosis import finish
    from hil.errors import InputError
    from hil.records.kind import fresh
    from hil.tracing.request import request_of
    from hil.tracing.trace import trace as trace_records

    if more and bench is None:
        raise InputError("--bench: missing; of several records, name the one for all of them")
    record = capture_in(capture)
    path = bench_file(bench, record, "trace")
    if add is not None:
        fresh(add, replace=replace)
    if (arm or link is not None) and not live:
        raise InputError("--link and --arm belong to --live; give it, or leave them out")
    request = request_of([record, *map(capture_in, more or ())], path, options)
    observed = _observed(request, add=add is not None, live=live)
    if observed is not None:
        prepare(observed)
    board = _board(link, path, observed, armed=arm) if live and observed is not None else None
    with watching("trace", whole=True) as watch:
        done = trace_records(request, out, progress=watch)
    if board is not None and observed is not None:
        done = _separated(done, observed, board, out, options)
    written = None
    if add is not None:
        from hil.cli.show import say
        from hil.tracing.addition import add_found

        names, told = add_found(done.diagnosis, path, add)
        say(told)
        written = add if names else None
    taken = record if board is None and not more else None
    finish(done.folder, done.diagnosis, as_json=json, added=written, record=taken)


def _observed(request: "TraceRequest", *, add: bool, live: bool) -> "Bench | None":
    """The bench of `request` where an observer runs on it.  Raises InputError where one is asked for that does not, or
    of several records.
    """
    from hil.bench import Bench
    from hil.errors import InputError

    bench = request.bench
    if not isinstance(bench, Bench):
        if add or live:
            raise InputError(f"{request.called}: a rate sensor, which no observer runs on; leave out --add and --live")
        return None
    if bench.device.sense.is_envelope:
        if add or live:
            raise InputError(f"{request.called}: an envelope, which no observer runs on; leave out --add and --live")
        return None
    if len(request.captures) > 1 and live:
        raise InputError("several records: they are held out whole, without --live; leave it out")
    if len(request.captures) > 1 and add:
        raise InputError("--add: of several records no bench file is written; copy what was found into [effects]")
    return bench


def _board(link: str | None, path: Path, declared: "Bench", *, armed: bool) -> str:
    """The link of the board for the experiment, consent to arm it given."""
    from hil.boards.emulation import is_emulated, located
    from hil.cli import consent
    from hil.errors import InputError

    if (place := declared.link.url if link is None else link) is None:
        raise InputError(f"{path}: [link] url: missing; give it there or as --link")
    url = located(place, beside=path)
    if not is_emulated(url):
        consent.require(url, declared, given=armed)
    return url


def _announced(asked: "Asked") -> None:
    """What will be done, and what somebody at the bench has to do for it."""
    from hil.cli.consent import have_it_turned
    from hil.cli.show import say

    say(f"experiment: {asked.words}")
    if asked.experiment.turning:
        have_it_turned(asked.turn)


def _separated(done: "Traced", bench: "Bench", board: str, out: Path, options: TraceOptions) -> "Traced":
    """What the last experiment came to; what was there before, where none was to be made."""
    from hil.cli.progress import watching
    from hil.cli.show import say
    from hil.tracing.separate import duration_for, last_traced, separable, separate, within_reach

    if not separable(done.diagnosis, bench):
        say("no experiment to make: no run on the board would separate effects that this record does not separate")
        for pair in within_reach(done.diagnosis):
            say(
                f"  {pair.effect} from {pair.with_} takes {pair.takes_s:.2g} s: {pair.separate_by}; for that, give "
                f"[loop] duration_s = {duration_for(pair):.2g} or more"
            )
        return done
    with watching("experiment") as watch:
        made = separate(
            done.diagnosis,
            bench,
            board,
            out,
            options=options,
            before_run=_announced,
            progress=watch,
        )
    for one in made:
        say(f"{one.run}: {one.experiment}")
        for pair in one.apart:
            say(f"  tells {pair.effect} from {pair.with_}")
        for pair in one.still_alike:
            say(f"  does not tell {pair.effect} from {pair.with_}")
        if one.refused is not None:
            say(f"  cannot be traced: {one.refused}")
    last = last_traced(made)
    return last or done
