"""``hil trace``: from the residual of a record to the effect that the model lacks."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, NoReturn

import typer

import hil
from hil.cli.options import RUNS, BenchOption, CaptureArgument, Json, Link, Name, Out, Replace, Report

if TYPE_CHECKING:
    from hil.bench import Bench
    from hil.library.tracing import Trace
    from hil.records.diagnosis import Diagnosis
    from hil.tracing.separate import Asked

Add = Annotated[
    Path | None,
    typer.Option(
        "--add",
        help="Bench file to write: the one given, with the effect found, or the form of what is missing, in it.",
    ),
]
Fraction = Annotated[
    float | None,
    typer.Option(
        "--fraction",
        help="Share of the record that is fitted; the rest only judges.  [default: the record's own segments, or 0.6]",
    ),
]
Live = Annotated[
    bool,
    typer.Option("--live", help="Make the experiment that tells apart what the record cannot, on the board at --link."),
]
More = Annotated[
    list[Path] | None,
    typer.Argument(metavar="[CAPTURE …]", help="Further records of the same device, to be traced together with it."),
]
Covariate = Annotated[
    str | None,
    typer.Option("--covariate", help="Number of each of several records that coefficients may depend on."),
]
HoldOut = Annotated[
    list[str] | None,
    typer.Option("--hold-out", help="Name of a record that only judges; repeatable.  [default: a third of them]"),
]
MissingForce = Annotated[
    bool | None,
    typer.Option(
        "--missing-force/--no-missing-force",
        help="Estimate the missing force without a name.  [default: where something is left and a report is drawn]",
    ),
]
Also = Annotated[
    list[str] | None,
    typer.Option(
        "--also",
        metavar="NAME[,NAME]",
        help="Of a single axis, effects to try that are tried on request only; repeatable.",
    ),
]
Arm = Annotated[bool, typer.Option("--arm", help="Consent to arming the board for it; emulated ones need none.")]


def trace(
    capture: CaptureArgument,
    bench: BenchOption = None,
    more: More = None,
    covariate: Covariate = None,
    hold_out: HoldOut = None,
    out: Out = RUNS,
    name: Name = None,
    add: Add = None,
    replace: Replace = False,
    fraction: Fraction = None,
    live: Live = False,
    link: Link = None,
    arm: Arm = False,
    report: Report = True,
    missing_force: MissingForce = None,
    also: Also = None,
    json: Json = False,
) -> None:
    """Find the effect that the model lacks.

    Runs the observer of the bench file over the record and examines the residual.
    Tries the effects of the catalogue, and those that the bench file or a package declares, on one part of the
    record, and judges them on the rest. Several records are traced together; each has a start of its own, and whole
    records are kept to judge by. Writes diagnosis.json and report.html. Exit code 0: nothing is missing, or what is
    missing has been found; 1: something is missing, and nothing accounts for all of it.
    Where something is left, the missing force is estimated without a name: the report draws it and proposes a form,
    force.arrow has it sample by sample (hil export makes CSV of it).

    Examples:

    \b
      hil trace last
      hil trace runs/first --bench s-undeclared --add better.bench.toml --replace
      hil trace runs/first --bench my.bench.toml --live --link serial:/dev/ttyACM0 --arm
      hil trace silverbox.arrow --bench silverbox --json
      hil trace load-0.arrow load-1.arrow load-2.arrow load-3.arrow --bench beam.bench.toml --covariate load_kg
      hil trace runs/first --bench s-undeclared --missing-force
      hil trace beam.arrow --bench beam.bench.toml --also hysteretic_stiffness,play
    """
    from hil.bench import RateSensorBench, load_any_bench
    from hil.cli.files import bench_file, capture_in, fresh
    from hil.cli.own import prepare
    from hil.cli.progress import watching
    from hil.cli.show import say
    from hil.cli.show_diagnosis import finish
    from hil.errors import InputError

    if more and bench is None:
        raise InputError("--bench: missing; of several records, name the one for all of them")
    record = capture_in(capture)
    path = bench_file(bench, record, "trace")
    declared = load_any_bench(path)
    if add is not None:
        fresh(add, replace=replace)
    if isinstance(declared, RateSensorBench) and (add is not None or live):
        raise InputError(f"{path}: a rate sensor, which no observer runs on; leave out --add and --live")
    envelope = not isinstance(declared, RateSensorBench) and declared.device.sense.is_envelope
    if envelope and (add is not None or live or more):
        raise InputError(f"{path}: an envelope, which is traced by itself and run by no observer; leave out --add, "
                         "--live and further records")  # fmt: skip
    if (arm or link is not None) and not live:
        raise InputError("--link and --arm belong to --live; give it, or leave them out")
    if not isinstance(declared, RateSensorBench) and not envelope:
        prepare(declared)
    if more:
        if live or missing_force or fraction is not None:
            raise InputError("several records: they are held out whole, without --live and --missing-force; leave "
                             "out these and --fraction")  # fmt: skip
        among = _Among(covariate, tuple(hold_out or ()), tuple(also or ()))
        _together([capture, *more], path, out, name, among, add, report=report, json=json)
    if covariate is not None or hold_out:
        raise InputError("--covariate and --hold-out belong to several records; name them, or leave those out")
    board = _board(link, path, declared, armed=arm) if live and not isinstance(declared, RateSensorBench) else None
    with watching("trace", whole=True) as watch:
        done = hil.trace(
            record, path, name=name, fraction=fraction, report=report, missing_force=missing_force, also=also or (),
            out=out, progress=watch,
        )  # fmt: skip
    if also and not isinstance(declared, RateSensorBench) and declared.device.axes == 2:
        say("--also: of two axes the whole catalogue is tried; leave it out")
    taken = None if board is not None else record
    if board is not None and not isinstance(declared, RateSensorBench):
        done = _separated(done, declared, board, out, fraction, also or ())
    written = add is not None and _added(done.diagnosis, path, add)
    finish(done.path, done.diagnosis, as_json=json, added=add if written else None, record=taken)


def _added(diagnosis: "Diagnosis", source: Path, target: Path) -> bool:
    """Write the bench file with what was found: the effects, or else the form of the missing force; whether any
    was."""
    from hil.cli.show import say
    from hil.tracing.addition import add_effects, add_form, additions

    found = additions(diagnosis)
    if found:
        add_effects(source, target, found)
        say(f"{target}: written; it declares {', '.join(one.name for one in found)}")
        return True
    missing = diagnosis.missing_force
    written, unwritten = ([], []) if missing is None else add_form(source, target, missing, diagnosis.record)
    memory = f"; {', '.join(unwritten)} has a memory, which no law of [effects.custom] has" if unwritten else ""
    if written:
        named = ", ".join(f"[effects.custom.{name}]" for name in written)
        say(f"{target}: written; no effect accounts for what is missing, so that it declares its form: {named}{memory}")
    else:
        zero = missing is not None and missing.form and not unwritten
        doubtful = ": each term of the form may as well be zero" if zero else ""
        say(f"{target}: not written; there is nothing to add{doubtful}{memory}")
    return bool(written)


class _Among(NamedTuple):
    """Of several records: what varies from one to the next, who is held out, what is tried on request."""

    covariate: str | None
    hold_out: tuple[str, ...]
    also: tuple[str, ...]


def _together(
    captures: list[Path],
    bench: Path,
    out: Path,
    name: str | None,
    among: _Among,
    add: Path | None,
    *,
    report: bool,
    json: bool,
) -> NoReturn:
    """Trace several records, and leave."""
    from hil.cli.files import capture_in
    from hil.cli.progress import watching
    from hil.cli.show_diagnosis import finish
    from hil.errors import InputError
    from hil.tracing.pooling import trace_pool_files

    if add is not None:
        raise InputError("--add: of several records no bench file is written; copy what was found into [effects]")
    with watching("trace", whole=True) as watch:
        done = trace_pool_files(
            [capture_in(each) for each in captures], bench, out, name=name, covariate=among.covariate,
            held_out=among.hold_out, report=report, also=among.also, progress=watch,
        )  # fmt: skip
    finish(done.folder, done.diagnosis, as_json=json)


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


def _separated(
    done: "Trace", bench: "Bench", board: str, out: Path, fraction: float | None, also: Sequence[str]
) -> "Trace":
    """What the last experiment came to; what was there before, where none was to be made."""
    from hil.cli.progress import watching
    from hil.cli.show import say
    from hil.library.tracing import Trace
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
            fraction=fraction,
            also=also,
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
    return done if last is None else Trace(last.folder, last.diagnosis)
