"""What one does with a bench: run it, replay a record, trace what its model lacks, score, load what there is.

Benches are given as objects, as paths, or by the name of an example.  Records are given as runs, as paths of a run
folder or a capture, or as arrays by the names of an interchange CSV.  Whatever cannot be used raises `InputError` with
one line that names the place and the remedy.
"""

import math
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack, get_args

import numpy.typing as npt

from hil.bench import Bench, RateSensorBench, load_any_bench
from hil.bench import load_bench as bench_at
from hil.bench.examples import find
from hil.errors import InputError, printable
from hil.errors.strict_toml import parse_table
from hil.library.arrays import CALLED, Table, columns_of, write_capture
from hil.library.campaign import Sweep
from hil.library.finished_run import Run
from hil.library.keywords import takes
from hil.library.live import Live
from hil.library.loading import load_trace
from hil.library.places import bench_file, folder_of, path_of, require
from hil.library.request import request_of, require_consent
from hil.library.series import Series
from hil.library.tracing import Trace
from hil.library.words import in_arguments_of, renamed, said_of_arguments
from hil.loop.options import LocalRunOptions
from hil.progress import Progress, Watcher
from hil.records.capture import Hold
from hil.records.listing import RUNS
from hil.records.methods import Methods
from hil.records.runfolder import RunFolder, bench_of_record
from hil.scoring.diff import Comparison
from hil.verdict.next_step import PASSING

if TYPE_CHECKING:
    from estimator.backend import Backend
    from hil.sweeping.campaign import Campaign

AnyBench = Bench | RateSensorBench | Path | str
Record = Run | Path | str | Mapping[str, npt.ArrayLike] | Table


def alarms_only(progress: Progress) -> None:
    """What nobody may miss goes to standard error, the rest nowhere."""
    if progress.alarm:
        print(printable(f"hil: UNSAFE: {progress.alarm}"), file=sys.stderr, flush=True)


@said_of_arguments
def load_bench(name: Path | str) -> Bench:
    """The bench file at a path, or the example of that name."""
    return bench_at(bench_file("name", name, "the path of a bench file or the name of an example"))


@said_of_arguments
@takes(LocalRunOptions)
def run(
    bench: Bench | Path | str,
    *,
    link: str | None = None,
    arm: bool = False,
    out: Path | str = RUNS,
    progress: Watcher = alarms_only,
    **options: Unpack[LocalRunOptions],
) -> Run:
    """Connect to a board, arm it, close the loop, record, and judge.

    link: default the bench file's.  `pty:SCENARIO` and `inproc:SCENARIO` start an emulated board; any other may lead to
    something that moves, and is armed with `arm=True` only.
    The run is recorded below `out`.  Raises InputError or WireError where no run could begin, Interrupted after Ctrl-C
    with SAFE sent and the record closed.
    """
    from hil.loop.run import run as run_loop

    request = request_of(bench, options, link=link)
    require_consent(request, given=arm)
    return _run_at(run_loop(request, path_of("out", out), progress=_watcher(progress)).folder)


@said_of_arguments
@takes(LocalRunOptions)
def dry_run(
    bench: Bench | Path | str,
    *,
    link: str | None = None,
    progress: Watcher = alarms_only,
    **options: Unpack[LocalRunOptions],
) -> dict[str, Any]:
    """Connect to a board, write its registers and read them back, compare it with the bench; nothing is armed, nothing
    recorded.  Returns its IDENTITY, by field.  As `run`, which see.
    """
    from hil.loop.run import run as run_loop

    request = request_of(bench, options, link=link, dry_run=True)
    return run_loop(request, RUNS, progress=_watcher(progress)).identity


@takes(LocalRunOptions)
def open_live(
    bench: Bench | Path | str,
    *,
    link: str | None = None,
    arm: bool = False,
    out: Path | str = RUNS,
    progress: Watcher = alarms_only,
    **options: Unpack[LocalRunOptions],
) -> Live:
    """A run to be looked at while it lasts, `hil.open`: `for block in hil.open(bench).stream()`.  As `run`, which see;
    nothing is connected before the first block is asked for.
    """
    with in_arguments_of(open_live):  # no decorator: hil.open is the same, and its type is plain
        request = request_of(bench, options, link=link)
        require_consent(request, given=arm)
        return Live(request, path_of("out", out), opened_by=open_live, progress=_watcher(progress))


@said_of_arguments
def record(
    link: str,
    *,
    duration_s: float = 10.0,
    name: str | None = None,
    note: str | None = None,
    report: bool = True,
    out: Path | str = RUNS,
    progress: Watcher = alarms_only,
) -> Run:
    """Record a sensor that puts out rates and cannot be driven, and check the record; a new run below `out`.

    link: `NAME:PATH[?baud=N]`, NAME being that of an adapter (`hil.boards`).  duration_s: of the sensor's time.  name:
    of the run, by default the adapter's.  Raises InputError or WireError where nothing was recorded;
    KeyboardInterrupt is passed on after the record is closed.
    """
    from hil.report.sensor import write_report
    from hil.sensors.adapter import find_port
    from hil.sensors.record import record as record_port

    require("link", link, str, "a text such as stim300:/dev/ttyUSB0")
    require("duration_s", duration_s, Real, "a number of seconds")
    if not 0.0 < duration_s < math.inf:
        raise InputError(f"--duration: {duration_s:g} s; give a time above 0")
    folder = record_port(
        find_port(link), link, path_of("out", out), name=name or link.partition(":")[0], seconds=duration_s, note=note,
        progress=_watcher(progress), report=write_report if report else None,
    )  # fmt: skip
    return _run_at(folder)


@said_of_arguments
def replay(
    record: Record,
    bench: Bench | Path | str | None = None,
    *,
    name: str | None = None,
    backend: "Backend | None" = None,
    hold: Hold = "zoh",
    nonuniform: bool = False,
    mapping: str | Path | None = None,
    out: Path | str = RUNS,
    progress: Watcher = alarms_only,
) -> Run:
    """Run the observer of a bench over a record; a new run below `out`.  bench: default that of a run.  hold: what the
    drive of arrays does between samples.  nonuniform: whether the time of arrays may be uneven.
    mapping: the map that says which array is what.
    """
    from hil.replaying.replay import replay as replay_record

    declared = _bench_for(record, bench)
    if isinstance(declared, RateSensorBench):
        raise InputError(f"{declared.device.name}: a rate sensor, which no observer runs on; trace its record")
    declared = declared.with_(loop={"name": name or f"{declared.loop.name}-replay"})
    with _captured(record, hold, nonuniform, mapping) as capture:
        done = replay_record(capture, declared, path_of("out", out), backend=backend, progress=_watcher(progress))
    return _run_at(done.folder)


@said_of_arguments
@renamed(force="missing_force")
def trace(
    record: Record,
    bench: AnyBench | None = None,
    *,
    fraction: float | None = None,
    name: str | None = None,
    hold: Hold = "zoh",
    nonuniform: bool = False,
    mapping: str | Path | None = None,
    report: bool = True,
    missing_force: bool | None = None,
    also: str | Sequence[str] = (),
    out: Path | str = RUNS,
    progress: Watcher = alarms_only,
) -> Trace:
    """Find the effect that the model lacks on a record; the answer is kept below `out`.

    bench: default that of a run.  fraction: share of the record that is fitted, the rest only judges.  hold: what the
    drive of arrays does between samples.  nonuniform: whether the time of arrays may be uneven.  mapping: the map
    that says which array is what.  missing_force: whether the missing force is estimated without a name, by default
    where something is left and a page is drawn.  also: effects to try that a trace tries on request only, a name or
    several.
    """
    from hil.tracing.trace import trace as trace_record
    from hil.tracing.trace import trace_file

    require("fraction", fraction, Real | None, "a number")
    asked_for, place, watcher = _names("also", also), path_of("out", out), _watcher(progress)
    declared = _bench_for(record, bench)
    with _captured(record, hold, nonuniform, mapping) as capture:
        if isinstance(declared, RateSensorBench):
            if not isinstance(bench, str | Path):
                raise InputError(f"{declared.device.name}: a rate sensor; give the path of its bench file")
            done = trace_file(
                capture, bench_file("bench", bench), place,
                name=name, fraction=fraction, report=report, missing_force=missing_force, also=asked_for,
                progress=watcher,
            )  # fmt: skip
        else:
            declared = declared.with_(loop={"name": name or f"{declared.loop.name}-trace"})
            done = trace_record(
                capture, declared, place, fraction=fraction, report=report, missing_force=missing_force, also=asked_for,
                progress=watcher,
            )  # fmt: skip
    return Trace(done.folder, done.diagnosis)


@said_of_arguments
def compare(
    record: Record,
    bench: Bench | Path | str | None = None,
    *,
    truth: Path | str | None = None,
    link: str | None = None,
    trace: Trace | Path | str | None = None,
    name: str | None = None,
    hold: Hold = "zoh",
    nonuniform: bool = False,
    mapping: str | Path | None = None,
    report: bool = True,
    out: Path | str = RUNS,
    progress: Watcher = alarms_only,
) -> Methods:
    """Run every method over a record, a row each: the observers with each gain, the prior art, the bound; the answer is
    kept below `out`.

    bench: default that of a run.  truth: what the emulated board of the record wrote; without it the record's rate
    channel is the reference.  link: an emulated board for the methods that close the loop themselves.  trace: of the
    record, whose effect the 13 states carry.  hold: what the drive of arrays does between samples.  nonuniform: whether
    the time of arrays may be uneven.  mapping: the map that says which array is what.
    """
    from hil.methods.comparing import compare as compare_record

    declared = _bench_for(record, bench)
    if isinstance(declared, RateSensorBench):
        raise InputError(f"{declared.device.name}: a rate sensor, which no observer runs on; trace its record")
    declared = declared.with_(loop={"name": name or f"{declared.loop.name}-compare"})
    found = None if trace is None else load_trace(trace).diagnosis
    with _captured(record, hold, nonuniform, mapping) as capture:
        done = compare_record(
            capture, declared, path_of("out", out),
            truth=None if truth is None else path_of("truth", truth), link=link,
            diagnosis=found, report=report, progress=_watcher(progress),
        )  # fmt: skip
    return done.methods


@said_of_arguments
def score(run: Run | Path | str, truth: Path | str) -> Run:
    """Compare a run with the truth that its emulated board wrote; figures are in `.result` then, and on the page."""
    from hil.report import write_report
    from hil.scoring.score import score as compare

    place, file = folder_of("run", run, "a Run or the path of its folder"), path_of("truth", truth)
    compare(place, file)
    if RunFolder(place).report_path.exists():
        write_report(place, file)
    return _run_at(place)


@said_of_arguments
def export(
    record: Run | Trace | Path | str, target: Path | str, *, to: str | None = None, what: str | Sequence[str] = ()
) -> Path:
    """Write what a run recorded and estimated, or the missing force of a trace, to `target`, which must not exist.

    to: csv, parquet, mat or mcap, by default as the name of `target` ends.  what: capture, estimates, angle, rate,
    innovation or force, of mat and mcap several; by default the capture, of mat and mcap all there is.
    """
    from hil.interchange.exporter import export as write
    from hil.interchange.exporter import format_for

    file, place = path_of("target", target), folder_of("record", record)
    if file.exists():
        raise InputError(f"{file}: exists already; give another name, or remove it")
    write(place, file, format_for(file, to), _names("what", what))
    return file


@said_of_arguments
def sweep(
    campaign: "Campaign | Mapping[str, object] | Path | str",
    *,
    out: Path | str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Watcher = alarms_only,
) -> Sweep:
    """Carry out a campaign, or what is left of it: a file, or what would stand in one.

    out: the folder of the results, by default runs/NAME; one that holds part of the same campaign is gone on in.
    workers: processes on this machine, by default one for each processor.  scheduler: address of a Dask scheduler,
    whose workers make the runs instead.  Raises InputError that names the key; whatever ends it, what is done is kept.
    """
    from hil.sweeping.campaign import Campaign
    from hil.sweeping.plan import plan_of, read_plan
    from hil.sweeping.sweep import sweep as carry_out

    if isinstance(campaign, str | Path):
        plan = read_plan(find("campaign", str(campaign)), called=str(campaign))
    else:
        known = campaign if isinstance(campaign, Campaign) else parse_table(campaign, Campaign, "the campaign")
        plan = plan_of(known, known.name)
    folder = RUNS / plan.campaign.name if out is None else path_of("out", out)
    require("workers", workers, Integral | None, "a whole number")
    done = carry_out(plan, folder, workers=workers, scheduler=scheduler, progress=_watcher(progress))
    if done.made:
        (folder / "report.html").unlink(missing_ok=True)
    return Sweep(plan, folder)


@said_of_arguments
def diff(a: Run | Trace | Path | str, b: Run | Trace | Path | str) -> Comparison:
    """Two runs, or two traces, side by side: figures with the difference b − a and its uncertainty (95 %), and the keys
    of the bench files that differ.
    """
    from hil.scoring.diff import compare

    return compare(folder_of("a", a), folder_of("b", b))


def _run_at(folder: Path | None) -> Run:
    assert folder is not None  # only a dry run leaves none
    return Run(RunFolder.open(folder))


def _bench_for(record: Record, bench: AnyBench | None) -> Bench | RateSensorBench:
    if isinstance(bench, Bench | RateSensorBench):
        return bench
    if bench is not None:
        return load_any_bench(bench_file("bench", bench))
    if isinstance(record, Run):
        return record.bench
    if isinstance(record, str | Path) and (own := bench_of_record(folder_of("record", record))) is not None:
        return load_any_bench(own)
    raise InputError("no bench: give the bench file that declares the device of this record")


@contextmanager
def _captured(record: Record, hold: Hold, nonuniform: bool, mapping: str | Path | None) -> Iterator[Path]:
    """The capture of a record; of arrays one that lasts as long as it is needed, and that no error names."""
    holds = get_args(Hold)
    if hold not in holds:
        raise InputError(f"hold: expected {', '.join(holds[:-1])} or {holds[-1]}, not {hold!r}")
    if (columns := columns_of(record)) is None:
        if mapping is not None:
            raise InputError("mapping: is for arrays; a file is imported by its map, and the capture given here")
        wanted = "a Run, the path of a run folder or of a capture, or arrays by name"
        place_of = folder_of("record", record, wanted)
        yield place_of / "capture.arrow" if place_of.is_dir() else place_of
        return
    with tempfile.TemporaryDirectory(prefix=PASSING) as place:
        capture = Path(place) / "arrays.arrow"
        own: Any = record.header.get("hold", hold) if isinstance(record, Series) else hold
        map_file = None if mapping is None else find("map", str(path_of("mapping", mapping)))
        write_capture(columns, capture, hold=own, nonuniform=nonuniform, map_file=map_file)
        try:
            yield capture
        except InputError as error:
            raise InputError(str(error).replace(str(capture), CALLED)) from None


def _names(argument: str, given: str | Sequence[str]) -> Sequence[str]:
    """One name or several, as a sequence.  Raises InputError for anything else."""
    if isinstance(given, str):
        return (given,)
    require(argument, given, Sequence, "a name or a list of names")
    for one in given:
        require(argument, one, str, "names")
    return given


def _watcher(progress: Watcher) -> Watcher:
    """`progress`, before anything begins that would break off at its first report."""
    require("progress", progress, Callable, "a function that takes a hil.progress.Progress")
    return progress
