"""The runs in a folder and what was made of them or beside them, oldest first."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal, NamedTuple

from hil.errors import InputError
from hil.records.atomic import is_occupied
from hil.records.direct import cut_of, on_disk
from hil.records.runfolder import RunFolder

RUNS = Path("runs")
"""Where runs and traces are kept, of the folder one works in."""

LAST = "last"
"""What stands for the newest run, wherever a run is named; where only a trace can be meant, for the newest trace."""

LAST_TRACE = "last-trace"
"""What stands for the newest trace, wherever a run or a trace is named."""

Kind = Literal["run", "trace", "sheet", "identify", "attitude"]
MARKS: dict[str, Kind] = {
    "diagnosis.json": "trace",
    "characteristics.json": "sheet",
    "identified.json": "identify",
    "attitude.json": "attitude",
}
"""Files by which a folder is something else than a run."""
PARTS = ("result.json", *MARKS, "capture.arrow", "estimates.arrow")
"""Files of which a folder that is listed has one."""
_STAMP = len("20250314-092653")
_SHOWN = 5  # names, where several are meant


class Listed(NamedTuple):
    """A run, a trace, a data sheet, an identification or an attitude.

    Its folder; verdict, "" where it has none yet; bench seconds of a run; what a trace named;
    why the folder cannot be read, "" else; the reasons of the verdict, or why there is none; the parts of a run's
    verdict against it; that the capture of a run was cut since its verdict, "" else.
    """

    path: Path
    kind: Kind
    verdict: str
    seconds: float | None = None
    named: tuple[str, ...] = ()
    unreadable: str = ""
    reasons: tuple[str, ...] = ()
    against: tuple[str, ...] = ()
    cut: str = ""


def listed(folder: Path) -> Iterator[Listed]:
    """All of them.  Raises InputError where there is no such folder."""
    for place in _by_time(folder):
        kind = listed_kind(place)
        try:
            yield _READ[kind](place)
        except InputError as error:
            yield Listed(place, kind, "", unreadable=str(error))


def listed_kind(place: Path) -> Kind:
    return next((kind for mark, kind in MARKS.items() if (place / mark).exists()), "run")


def beside_runs(place: Path) -> Listed:
    """A data sheet, an identification, an attitude.  Raises InputError."""
    return _READ[listed_kind(place)](place)


def last_run(folder: Path) -> Path:
    """The newest run below `folder`.  Raises InputError where there is none."""
    runs = [place for place in _by_time(folder) if RunFolder(place).capture_path.exists()]
    if not runs:
        raise InputError(f"{LAST}: no run in {folder}/; make one (hil run s-slow), or name its folder")
    return runs[-1]


def last_trace(folder: Path, word: str = LAST_TRACE) -> Path:
    """The newest trace below `folder`, asked for as `word`.  Raises InputError where there is none."""
    traces = [place for place in _by_time(folder) if _is_trace(place)]
    if not traces:
        raise InputError(f"{word}: no trace in {folder}/; make one (hil trace {LAST}), or name its folder")
    return traces[-1]


def named(place: Path | str, folder: Path = RUNS) -> Path:
    """The path meant by `place`: `last` is the newest run in `folder`, `last-trace` the newest trace, a name or the
    beginning of one what `folder` has by it, unless something where hil is called has that name.

    Raises InputError where there is no newest one, or where several begin with the name.
    """
    path = Path(place)
    if path.exists():
        return path
    if str(place) in (LAST, LAST_TRACE):
        return last_run(folder) if str(place) == LAST else last_trace(folder)
    return _begun(path, folder, lambda _: True)


def _begun(path: Path, folder: Path, meant: Callable[[Path], bool]) -> Path:
    """The run or trace in `folder` whose name is `path`, or the only one of those meant that begins with it; `path`
    itself where there is none. Raises InputError where there are several.
    """
    if len(path.parts) != 1 or not folder.is_dir():
        return path
    if (folder / path).exists():
        return folder / path
    found = [one for one in _by_time(folder) if one.name.startswith(path.name) and meant(one)]
    if len(found) > 1:
        names = ", ".join(one.name for one in found[:_SHOWN]) + (", …" if len(found) > _SHOWN else "")
        raise InputError(f"{path}: {len(found)} in {folder}/ begin with it: {names}; give more of the name")
    return found[0] if found else path


def named_trace(place: Path | str, folder: Path = RUNS) -> Path:
    """The same where only a trace can be meant: `last` is the newest trace too."""
    path = Path(place)
    if path.exists() or str(place) == LAST_TRACE:
        return named(path, folder)
    return last_trace(folder, LAST) if str(place) == LAST else _begun(path, folder, _is_trace)


def _is_trace(place: Path) -> bool:
    return (place / "diagnosis.json").exists()


def _by_time(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise InputError(
            f"{folder}: no such folder; runs are kept in runs/ where hil is called: go there, or name their folder"
        )
    found = [place for place in folder.iterdir() if any((place / part).exists() for part in PARTS)]
    return sorted(found, key=lambda place: (place.name[:_STAMP], place.stat().st_mtime_ns))


def _run(place: Path) -> Listed:
    run = RunFolder(place)
    _ = run.bench_text  # of a run whose bench file was changed the figures say nothing
    if not run.result_path.exists():
        return Listed(place, "run", "", reasons=_without_figures(run))
    from hil.records.result import load_result  # where figures are asked for, and only there

    result = load_result(run.result_path)
    against = result.against
    reasons = result.reasons or tuple(filter(None, against.values()))
    cut = cut_of(run.capture_path) if result.complete and run.capture_path.exists() else ""
    return Listed(place, "run", result.verdict or "", result.seconds, reasons=reasons, against=tuple(against), cut=cut)


def _without_figures(run: RunFolder) -> tuple[str, ...]:
    """Why a run has none, where nobody works on it."""
    if not run.bench or is_occupied(run.path):
        return ()
    try:
        meant = round(run.bench["loop"]["duration_s"] * run.bench["device"]["sample_rate_Hz"])
    except (KeyError, TypeError):
        meant = None
    return (f"{on_disk(run.capture_path).told(meant)}: `hil replay` computes its figures",)


def _trace(place: Path) -> Listed:
    from hil.records.diagnosis import load_diagnosis  # knows the estimator's words, which the rest needs not

    diagnosis = load_diagnosis(place / "diagnosis.json")
    _ = RunFolder(place).bench_text
    named = tuple(effect.name for effect in diagnosis.effects)
    return Listed(place, "trace", diagnosis.verdict, named=named, reasons=diagnosis.reasons)


def _sheet(place: Path) -> Listed:
    from hil.records.data_sheet import load_data_sheet

    sheet = load_data_sheet(place / "characteristics.json")
    reasons = tuple(f"{row.title} {row.axis} is beyond its limit" for row in sheet.rows if row.kept is False)
    return Listed(place, "sheet", sheet.verdict, sheet.seconds, reasons=reasons)


def _identified(place: Path) -> Listed:
    path = place / "identified.json"
    try:
        faults = tuple(map(str, json.loads(path.read_text(encoding="utf-8"))["faults"]))
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"{path}: cannot be read; identify the board again") from None
    return Listed(place, "identify", "failed" if faults else "good", reasons=faults)


def _attitude(place: Path) -> Listed:
    from hil.records.attitude import load_attitude_result

    found = load_attitude_result(place)
    return Listed(place, "attitude", found.verdict, found.seconds, reasons=tuple(filter(None, (found.without,))))


_READ: dict[Kind, Callable[[Path], Listed]] = {
    "run": _run,
    "trace": _trace,
    "sheet": _sheet,
    "identify": _identified,
    "attitude": _attitude,
}
