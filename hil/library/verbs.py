"""What one does with a bench: run it, replay a record, trace what its model lacks, score, load what there is.

Benches are given as objects, as paths, or by the name of an example.  Records are given as runs, as paths of a run
folder or a capture, or as arrays by the names of an interchange CSV.  Whatever cannot be used raises `InputError` with
one line that names the place and the remedy.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack, cast, get_type_hints

from hil.bench import Bench
from hil.bench import load_bench as bench_at
from hil.bench.examples import bench_file
from hil.characterising.options import LocalCharacteriseOptions
from hil.comparing.diff import Comparison
from hil.errors import InputError
from hil.errors.input import names_of, path_of, require
from hil.identifying.options import LocalIdentifyOptions
from hil.importing.options import ImportOptions, LocalImportOptions
from hil.library.campaign import Sweep
from hil.library.given import AnyBench, Record, Records, bench_for, captured, observed_bench_for
from hil.library.keywords import in_arguments_of, said_of_arguments, takes
from hil.library.live import Live
from hil.library.loading import AttitudeRun, Run, Trace, folder_of, load_trace
from hil.progress import Watcher, alarms_only
from hil.records.methods import Methods
from hil.records.runfolder import RunFolder
from hil.records.runs import RUNS
from hil.replaying.options import ReplayOptions
from hil.running.options import LocalRunOptions
from hil.running.process.start import started_ahead
from hil.running.request import request_of, require_consent
from hil.sensors.options import LocalRecordOptions
from hil.sweeping.options import LocalSweepOptions
from hil.tracing.options import TraceOptions

if TYPE_CHECKING:
    from hil.identifying.identify import Identified
    from hil.importing.importer import Imported
    from hil.library.sheets import Sheet, SheetRecord
    from hil.sweeping.request import AnyCampaign


@said_of_arguments
def load_bench(name: Path | str) -> Bench:
    """The bench file at a path, or the example of that name."""
    return bench_at(bench_file("name", name, "the path of a bench file or the name of an example"))


@said_of_arguments
@takes(LocalRunOptions)
def run(
    bench: Bench | Path | str | Sequence[Bench | Path | str],
    *,
    link: str | Sequence[str] | None = None,
    mount: Path | str | None = None,
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

    A list of up to three benches with `mount`, the file that says where their sensitive axes point, runs them at once,
    with one stop for all, and gives an `AttitudeRun`; `link` is then a list of as many.
    """
    if mount is not None or (isinstance(bench, Sequence) and not isinstance(bench, str)):
        return _run_several(bench, link, mount, arm, out, progress, options)
    if isinstance(link, Sequence) and not isinstance(link, str):
        raise InputError("link: a list goes with a list of benches; give one text")
    request = request_of(bench, options, link=link)
    require_consent(request, given=arm)
    with started_ahead():
        from hil.running.run import run as run_loop

        return _run_at(run_loop(request, path_of("out", out), progress=_watcher(progress)).folder)


def _run_several(
    benches: Any, links: Any, mount: Any, arm: bool, out: Path | str, progress: Watcher, options: LocalRunOptions
) -> AttitudeRun:
    from hil.bench.mount import load_mount
    from hil.running.several import requests_of, run_several

    if mount is None:
        raise InputError("mount: missing; several gyros need the file that says where their sensitive axes point")
    requests = requests_of(benches, links, options)
    for request in requests:
        require_consent(request, given=arm)
    declared = load_mount(path_of("mount", mount))
    return AttitudeRun(run_several(requests, declared, path_of("out", out), progress=_watcher(progress)))


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
    from hil.running.run import run as run_loop

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
@takes(LocalRecordOptions)
def record(
    link: str, *, out: Path | str = RUNS, progress: Watcher = alarms_only, **options: Unpack[LocalRecordOptions]
) -> Run:
    """Record a sensor that puts out rates and cannot be driven, and check the record; a new run below `out`.

    link: `NAME:PLACE[?baud=N]`, NAME being serial, can, replay or that of a sensor (`hil.boards`).  Raises InputError
    or WireError where nothing was recorded; KeyboardInterrupt is passed on after the record is closed.
    """
    from hil.report.sensor import write_report
    from hil.sensors.record import record as record_port
    from hil.sensors.request import request_of as recording

    request = recording(link, options)
    return _run_at(record_port(request, path_of("out", out), progress=_watcher(progress), report=write_report))


@said_of_arguments
@takes(LocalIdentifyOptions)
def identify(
    link: str | None = None,
    *,
    bench: Path | str | None = None,
    arm: bool = False,
    out: Path | str = RUNS,
    progress: Watcher = alarms_only,
    **options: Unpack[LocalIdentifyOptions],
) -> "Identified":
    """Find a board's constants by an experiment, and hold them against what it says of itself.

    link: as of `run`, or None with `record`.  bench: the bench file to write; none is written where the board does not
    do what it says (`.good`).  Records and page are in a new folder below `out`.  Raises as `run`, and InputError where
    nothing moves.
    """
    from hil.identifying import request
    from hil.identifying.identify import identify as carry_out

    asked = request.request_of(link, None if bench is None else path_of("bench", bench), options)
    request.require_consent(asked, given=arm)
    return carry_out(asked, path_of("out", out), _watcher(progress))


@said_of_arguments
@takes(LocalImportOptions)
def import_record(source: Path | str, **options: Unpack[LocalImportOptions]) -> "Imported":
    """Turn a record from elsewhere into a capture, which the other verbs take by its `path`: delimited text, MATLAB,
    Parquet, and what a package reads (`hil.importers`).  Raises InputError with file, line or column.
    """
    from hil.importing.importer import import_file
    from hil.importing.request import request_of as importing

    return import_file(importing(source, options))


class ArrayReplayOptions(ReplayOptions, ImportOptions, total=False):
    """What may be asked of a replay of a record that may be arrays."""


@said_of_arguments
@takes(ArrayReplayOptions)
def replay(
    record: Record,
    bench: Bench | Path | str | None = None,
    *,
    out: Path | str = RUNS,
    progress: Watcher = alarms_only,
    **options: Unpack[ArrayReplayOptions],
) -> Run:
    """Run the observer of a bench over a record; a new run below `out`.  bench: default that of a run.  `mapping`,
    `hold` and `nonuniform` are for arrays.
    """
    from hil.replaying.replay import replay as replay_record

    declared = observed_bench_for(record, bench, options.get("name") or "{}-replay")
    with captured(record, _of_arrays(options)) as (capture,):
        done = replay_record(
            capture, declared, path_of("out", out), backend=options.get("backend"), progress=_watcher(progress)
        )  # fmt: skip
    return _run_at(done.folder)


class ArrayTraceOptions(TraceOptions, ImportOptions, total=False):
    """What may be asked of a trace of records that may be arrays."""


@said_of_arguments
@takes(ArrayTraceOptions)
def trace(
    record: Records,
    bench: AnyBench | None = None,
    *,
    out: Path | str = RUNS,
    progress: Watcher = alarms_only,
    **options: Unpack[ArrayTraceOptions],
) -> Trace:
    """Find the effect that the model lacks on a record, or on those of a list together; the answer is kept below `out`.

    bench: default that of a run.  `mapping`, `hold` and `nonuniform` are for arrays.
    """
    from hil.tracing.request import request_of as tracing
    from hil.tracing.trace import trace as trace_records

    place, watcher = path_of("out", out), _watcher(progress)
    asked: Any = {key: value for key, value in options.items() if key not in get_type_hints(ImportOptions)}
    declared = bench_for(record, bench)
    with captured(record, _of_arrays(options)) as captures:
        done = trace_records(tracing(captures, declared, asked), place, progress=watcher)
    return Trace(done.folder, done.diagnosis)


@said_of_arguments
@takes(ImportOptions)
def compare(
    record: Record,
    bench: Bench | Path | str | None = None,
    *,
    truth: Path | str | None = None,
    link: str | None = None,
    trace: Trace | Path | str | None = None,
    name: str | None = None,
    report: bool = True,
    out: Path | str = RUNS,
    progress: Watcher = alarms_only,
    **arrays: Unpack[ImportOptions],
) -> Methods:
    """Run every method over a record, a row each: the observers with each gain, the prior art, the bound; the answer is
    kept below `out`.

    bench: default that of a run.  truth: what the emulated board of the record wrote; without it the record's rate
    channel is the reference.  link: an emulated board for the methods that close the loop themselves.  trace: of the
    record, whose effect the 13 states carry.  `mapping`, `hold` and `nonuniform` are for arrays.
    """
    from hil.comparing.methods import compare as compare_record

    declared = observed_bench_for(record, bench, name or "{}-compare")
    found = None if trace is None else load_trace(trace).diagnosis
    with captured(record, arrays) as (capture,):
        done = compare_record(
            capture, declared, path_of("out", out),
            truth=None if truth is None else path_of("truth", truth), link=link,
            diagnosis=found, report=report, progress=_watcher(progress),
        )  # fmt: skip
    return done.methods


@said_of_arguments
@takes(LocalCharacteriseOptions)
def characterise(
    records: "SheetRecord | Sequence[SheetRecord]",
    bench: AnyBench | None = None,
    *,
    out: Path | str = RUNS,
    progress: Watcher = alarms_only,
    **options: Unpack[LocalCharacteriseOptions],
) -> "Sheet":
    """The figures of a data sheet, with intervals, from records of one device: whole-angle runs, recorded sensors, or
    imported captures with the bench file of their sensor; the answer is kept below `out`.

    records: runs, paths, or the link of a sensor, which is recorded first.  bench: whose [limits] the figures are held
    against; default that of the first run.
    """
    from hil.characterising.characterise import characterise as characterise_records
    from hil.characterising.request import request_of as characterising
    from hil.library.sheets import Sheet, recorded_at

    place, watcher = path_of("out", out), _watcher(progress)
    done = characterise_records(
        characterising(recorded_at(records, place, options, watcher), bench, options), place, progress=watcher
    )
    return Sheet(done.folder, done.sheet, done.calibration)


@said_of_arguments
def score(run: Run | Path | str, truth: Path | str) -> Run:
    """Compare a run with the truth that its emulated board wrote; figures are in `.result` then, and on the page."""
    from hil.report.page import write_report
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
    from hil.exporting.exporter import export as write
    from hil.exporting.exporter import format_for

    file, place = path_of("target", target), folder_of("record", record)
    if file.exists():
        raise InputError(f"{file}: exists already; give another name, or remove it")
    write(place, file, format_for(file, to), names_of("what", what))
    return file


@said_of_arguments
@takes(LocalSweepOptions)
def sweep(campaign: "AnyCampaign", *, progress: Watcher = alarms_only, **options: Unpack[LocalSweepOptions]) -> Sweep:
    """Carry out a campaign, or what is left of it: a file, or what would stand in one.

    A folder `out` that holds part of the same campaign is gone on in.  Raises InputError that names the key; whatever
    ends it, what is done is kept.
    """
    from hil.library.campaign import carried_out
    from hil.sweeping.request import request_of as sweeping

    return carried_out(sweeping(campaign, options), _watcher(progress))


@said_of_arguments
def diff(a: Run | Trace | Path | str, b: Run | Trace | Path | str) -> Comparison:
    """Two runs, or two traces, side by side: figures with the difference b − a and its uncertainty (95 %), and the keys
    of the bench files that differ.
    """
    from hil.comparing.diff import compare

    return compare(folder_of("a", a), folder_of("b", b))


def _run_at(folder: Path | None) -> Run:
    assert folder is not None  # only a dry run leaves none
    return Run(RunFolder.open(folder))


def _of_arrays(options: Mapping[str, Any]) -> ImportOptions:
    """Of the options those by which arrays are understood."""
    return cast(ImportOptions, {key: options[key] for key in get_type_hints(ImportOptions) if key in options})


def _watcher(progress: Watcher) -> Watcher:
    """`progress`, before anything begins that would break off at its first report."""
    require("progress", progress, Callable, "a function that takes a hil.progress.Progress")
    return progress
