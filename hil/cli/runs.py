"""``hil ls`` and ``hil show``: the runs that are there, and what one of them came to."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hil.cli.options import RUNS, Json, Replace

if TYPE_CHECKING:
    from hil.records.diagnosis import Diagnosis
    from hil.records.runs import Listed

Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="Where runs were recorded.")]
Junit = Annotated[
    Path | None, typer.Option("--junit", help="Write the verdicts as JUnit XML too, for continuous integration.")
]
Add = Annotated[
    Path | None,
    typer.Option("--add", help="Bench file to write: that of the trace with what it found, without tracing again."),
]
Place = Annotated[
    Path,
    typer.Argument(
        metavar="RUN",
        help="Folder of a run or a trace, or the beginning of its name in runs/; `last` is the newest run, "
        "`last-trace` the newest trace.",
    ),
]


def ls(folder: Folder = RUNS, json: Json = False, junit: Junit = None, replace: Replace = False) -> None:
    """List the runs, traces, data sheets, identifications and attitudes of a folder, oldest first, with verdicts.

    A failed verdict is followed by the parts that failed, and by the reason. Other verbs accept a name from this list,
    or the beginning of a name: `hil show NAME`.

    Examples:

    \b
      hil ls
      hil ls bench3/runs --json
      hil ls --junit verdicts.xml --replace
    """
    from hil.cli.show import print_json
    from hil.records.runs import listed

    if junit is not None:
        from hil.records.kind import fresh

        fresh(junit, replace=replace)
    found = list(listed(folder))
    if junit is not None:
        _write_junit(found, folder, junit)
    if json:
        print_json({"folder": str(folder), "runs": [_as_json(one) for one in found]})
    else:
        _print(found, folder)


def show(run: Place, add: Add = None, replace: Replace = False, json: Json = False) -> None:
    """Show the result of a run or a trace again; the exit code is that of the run or trace.

    Examples:

    \b
      hil show last
      hil show last-trace
      hil show last-trace --add better.bench.toml
      hil show 20250314-09
      hil show runs/20250314-092653-s-slow --json
    """
    from hil.cli.options import run_folder

    folder = run_folder(run)
    if (folder / "diagnosis.json").exists():
        from hil.cli.show_diagnosis import finish as finish_trace
        from hil.records.diagnosis import load_diagnosis

        diagnosis = load_diagnosis(folder / "diagnosis.json")
        written = None if add is None else _added(folder, diagnosis, add, replace=replace)
        finish_trace(folder, diagnosis, as_json=json, added=written)
    from hil.cli.show import finish, finish_attitude
    from hil.errors import InputError
    from hil.records.kind import kind_of
    from hil.records.runfolder import RunFolder
    from hil.records.runs import listed_kind

    if add is not None:
        raise InputError(f"--add: {folder} is no trace; give the folder of one, or last-trace")
    if (folder / "attitude.json").exists():
        finish_attitude(folder, as_json=json)
    kind = listed_kind(folder)
    if kind in ("sheet", "identify"):
        raise InputError(f"{folder}: is {kind_of(folder)}; open {folder / 'report.html'}, or list it with hil ls")
    if not RunFolder.open(folder).result_path.exists():
        raise InputError(f"{folder}: no result.json; `hil replay {folder}` computes its figures")
    finish(folder, as_json=json)


def _added(folder: Path, diagnosis: "Diagnosis", target: Path, *, replace: bool) -> Path | None:
    """The bench file that was written, the trace's own with what it found; None where there was nothing to add."""
    from hil.cli.show import say
    from hil.errors import InputError
    from hil.records.kind import fresh
    from hil.toml.reading import read_table
    from hil.tracing.addition import add_found
    from hil.verdict.next_step import declarable

    fresh(target, replace=replace)
    source = folder / "bench.toml"
    if not declarable(diagnosis, read_table(source).get("device", {})):
        raise InputError(
            f"--add: {folder} is of several records, of a rate sensor or of an envelope, for which no bench file is "
            "written; copy what was found into [effects]"
        )
    names, told = add_found(diagnosis, source, target)
    say(told)
    return target if names else None


def _write_junit(found: list["Listed"], folder: Path, target: Path) -> None:
    from hil.records.atomic import write_text
    from hil.records.junit import Case, junit_xml

    cases = []
    for one in found:
        reasons = (one.unreadable,) if one.unreadable else one.reasons
        cases.append(Case(one.path.name, _device(one.path), one.verdict, one.seconds, reasons))
    write_text(target, junit_xml(cases, folder.resolve().name))


def _device(folder: Path) -> str:
    """What the bench file calls the device, "" where none can be read."""
    from hil.errors import InputError
    from hil.records.runfolder import RunFolder

    try:
        device = RunFolder(folder).bench.get("device")
    except InputError:
        return ""
    name = device.get("name") if isinstance(device, dict) else None
    return name if isinstance(name, str) else ""


def _as_json(one: "Listed") -> dict[str, object]:
    return {
        "path": str(one.path),
        "kind": one.kind,
        "verdict": one.verdict or None,
        "seconds": one.seconds,
        "against": list(one.against),
        "reasons": list(one.reasons),
        "cut": one.cut or None,
        "effects": list(one.named),
        "unreadable": one.unreadable or None,
    }


def _print(found: list["Listed"], folder: Path) -> None:
    from hil.errors import printable

    if not found:
        print(printable(f"{folder}: no runs yet; next: hil run s-slow"))
    rows = [(str(one.path) if folder != RUNS else one.path.name, one.kind, _verdict(one), _told(one)) for one in found]
    names, verdicts = (max((len(row[column]) for row in rows), default=0) for column in (0, 2))
    for name, kind, verdict, told in rows:
        print(printable(f"{name:<{names}}  {kind:<8}  {verdict:<{verdicts}}  {told}".rstrip()))


def _verdict(one: "Listed") -> str:
    """The verdict with the parts that are against the run."""
    if not one.verdict:
        return "unreadable" if one.unreadable else "no figures" if one.reasons else "no verdict yet"
    return f"{one.verdict}: {', '.join(one.against)}" if one.against else one.verdict


def _told(one: "Listed") -> str:
    """How long a run was, what a trace named, and the beginning of the first reason of a verdict against it."""
    from hil.records.junit import PASSED

    if one.unreadable:
        return one.unreadable
    length = ", ".join(one.named) or ("" if one.seconds is None else f"{one.seconds:.4g} s")
    why = one.reasons[0].partition(";")[0] if one.reasons and one.verdict not in PASSED else ""
    return "  ".join(filter(None, (length, why, one.cut)))
