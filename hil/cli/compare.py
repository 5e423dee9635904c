"""``hil compare``: every method on one record, one table and one figure."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hil.cli.options import RUNS, BenchOption, CaptureArgument, Json, Name, Out, Report
from hil.errors.ending import ExitCode

if TYPE_CHECKING:
    from hil.comparing.methods import Compared
    from hil.records.diagnosis import Diagnosis

_COLUMNS = 100
"""Of a terminal in which the tables fit."""
TruthFile = Annotated[
    Path | None,
    typer.Option("--truth", help="File the emulated board of the record wrote; for errors and for the bound."),
]
Board = Annotated[
    str | None,
    typer.Option(
        "--link",
        "-l",
        help="Emulated board, inproc:SCENARIO or pty:SCENARIO, for the methods that close the loop themselves.",
    ),
]
Traced = Annotated[
    Path | None,
    typer.Option(
        "--diagnosis",
        help="Folder of a trace of the record, or `last`, the newest trace: the 13-state observer includes its effect.",
    ),
]
Trace = Annotated[
    bool, typer.Option("--trace", help="Trace the record first; the 13-state observer then includes the effect found.")
]


def compare(
    capture: CaptureArgument,
    bench: BenchOption = None,
    truth: TruthFile = None,
    link: Board = None,
    diagnosis: Traced = None,
    trace: Trace = False,
    out: Out = RUNS,
    name: Name = None,
    report: Report = True,
    json: Json = False,
) -> None:
    """Compare all methods on one record.

    Methods: the observers of 7, 11 and 13 states with each gain; the prior art (the rate estimated and integrated, the
    formula of the pattern angle on the raw signals, the control law without sense errors, Park–Horowitz,
    Friedland–Hutton); last the posterior Cramér–Rao bound. The table has errors of angle, rate and parameters,
    uncertainties, when a method settled or diverged, and what a sample costs. Writes comparison.json and report.html.
    Exit code 0: compared; 1: the bench file's own observer diverged on the record.
    Errors need a reference: the truth of an emulated board, or the rate channel of the record.

    Examples:

    \b
      hil run s-slow --link inproc:s-slow --clock lockstep --truth truth.arrow --replace
      hil compare last --truth truth.arrow --link inproc:s-slow
      hil compare last --truth truth.arrow --trace --json
      hil compare last --bench s-classic --diagnosis last
    """
    from hil.bench import load_bench, override
    from hil.cli.consent import prepare
    from hil.cli.options import bench_file, capture_in
    from hil.cli.progress import watching
    from hil.errors import InputError

    if trace and diagnosis is not None:
        raise InputError("--trace and --diagnosis: one of them says what the record lacks; leave out the other")
    place = capture_in(capture)
    path = bench_file(bench, place, "compare")
    declared = load_bench(path)
    prepare(declared)
    from hil.comparing.methods import compare as compare_record  # loads the estimator: after what can be refused

    named = override(declared, {"loop": {"name": name or f"{declared.loop.name}-compare"}}, str(path))
    with watching("compare") as watch:
        found = _diagnosis(diagnosis)
        if trace:
            from hil.tracing.request import request_of
            from hil.tracing.trace import trace as trace_record

            found = trace_record(request_of(place, named, {"report": report}), out, progress=watch).diagnosis
        done = compare_record(place, named, out, truth=truth, link=link, diagnosis=found, report=report, progress=watch)
    _finish(done, place, as_json=json)


def _diagnosis(folder: Path | None) -> "Diagnosis | None":
    if folder is None:
        return None
    from hil.records.diagnosis import load_diagnosis
    from hil.records.runs import named_trace

    folder = named_trace(folder)
    return load_diagnosis(folder / "diagnosis.json" if folder.is_dir() else folder)


def _finish(done: "Compared", record: Path, *, as_json: bool) -> None:
    from hil.cli.show import print_json

    if as_json:
        print_json({"folder": str(done.folder), **done.methods.model_dump(mode="json")})
    else:
        _print(done, record)
    raise typer.Exit(ExitCode.AGAINST if done.diverged else ExitCode.GOOD)


def _print(done: "Compared", record: Path) -> None:
    from hil.cli.output import Output
    from hil.report.methods import SHORT, headline, sheet_rows, short_cells
    from hil.verdict.next_step import after_comparison

    found, output = done.methods, Output()
    output.table(SHORT, list(map(short_cells, found.rows)), right=range(1, len(SHORT)), fit=_COLUMNS)
    output.say()
    head, sheet = sheet_rows(found, short=True)
    if sheet:
        output.table(head, sheet, right=range(1, len(head)), fit=_COLUMNS)
        output.say()
    for remark in found.remarks:
        output.say(remark)
    _, word, sentence = headline(found)
    output.say(f"{word}  {sentence}")
    output.say(str(done.folder))
    output.say(f"next  {after_comparison(done.folder, found, record=record)}")
