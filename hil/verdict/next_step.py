"""The command that comes next, after a run, a trace and a comparison: each ends with one, on the terminal and on its
page.
"""

import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hil.bench import Bench, load_bench
from hil.boards.emulation import located
from hil.errors import InputError
from hil.records.diagnosis import Diagnosis
from hil.records.methods import Methods
from hil.records.result import Part, Result, RunVerdict
from hil.records.runfolder import RunFolder, run_of
from hil.toml.reading import read_table
from hil.verdict.model import trace_command

_ADDED = "better.bench.toml"
_ANOTHER = "OTHER.arrow"
"""Stands for a record that is yet to be made."""

_ARRAYS = "ARRAYS.arrow"
"""Stands for arrays that were given from memory, which are in no file."""

PASSING = "gyrohil-arrays-"
"""How the folder is called in which such arrays are while they are traced or compared."""

_OF_THE_LOOP = {"--clock": "clock", "--duration": "duration_s", "--seed": "seed"}
_SEVERAL = re.compile(r"\d+ records: ")


def after_run(verdict: RunVerdict, parts: Mapping[str, Part], folder: RunFolder, result: Result) -> str:
    """What one does with such a run where no reason has a cure.  A look at the report where its reasons are to be
    mended by hand.
    """
    place = shlex.quote(str(folder.path))
    if verdict == "interrupted":
        return f"hil check {place}"
    if verdict == "good":
        return f"hil export {place} --what {'estimates' if result.angle is None else 'angle'}"
    if result.innovation_rms is not None:
        if parts["model"].against:
            return trace_command(folder)
        if parts["angle"].against and result.angle is not None:
            return f"hil compare {place}"
    return f"xdg-open {shlex.quote(str(folder.report_path))}"


def after_trace(
    folder: Path, diagnosis: Diagnosis, added: Path | None = None, *, record: Path | None = None
) -> str | None:
    """The command after the trace in `folder`; None only where the folder has no bench file, which every trace writes.

    added: bench file that declares what was found, where one was written.  record: the capture that was traced; without
    it the run beside `folder` that has the record's name, or an imported record of that name.
    """
    bench = folder / "bench.toml"
    if not bench.exists():
        return None if added is None else f"hil run {_quoted(added)}"
    device = read_table(bench).get("device", {})
    place = _place(folder, diagnosis.record, record)
    if added is not None:
        if place.is_dir():
            return _run_as(RunFolder(place), added)
        return f"hil replay {_quoted(place)} --bench {_quoted(added)}"
    if diagnosis.fault or not declarable(diagnosis, device):
        return _traced(Path(_ANOTHER), bench)
    again = _traced(place, bench)
    if diagnosis.verdict == "adequate":
        return _used(place, bench, device)
    declare = f"hil show {_quoted(folder)} --add {_ADDED}"
    if diagnosis.verdict == "explained":
        return declare
    if place.is_dir() and any(pair.experiment is not None for pair in diagnosis.separations):
        return f"{again} --live"
    missing = diagnosis.missing_force
    if missing is None:
        return f"{again} --missing-force"
    if any(term.declarable for term in missing.form):
        return declare
    if missing.refused is None:
        return f"hil export {_quoted(folder)} --what force"
    return _traced(Path(_ANOTHER), bench)


def declarable(diagnosis: Diagnosis, device: Any) -> bool:
    """Whether a bench file can declare what a trace found, by its table `device`: not of several records, a rate sensor
    or an envelope.
    """
    return not (_SEVERAL.match(diagnosis.record) or _has_no_loop(device))


def after_comparison(folder: Path, methods: Methods, *, record: Path | None = None) -> str:
    """The command after the comparison in `folder`: what the model lacks, or the bench file that declares what was
    included already.  record: as of `after_trace`.
    """
    again = _traced(_place(folder, methods.record, record), folder / "bench.toml")
    return f"{again} --add {_ADDED}" if any(row.kind == "traced" for row in methods.rows) else again


def _place(folder: Path, name: str, record: Path | None) -> Path:
    """A run's folder, or the file of another record."""
    if record is not None:
        return Path(_ARRAYS) if record.parent.name.startswith(PASSING) else run_of(record)
    run = folder.parent / name
    return run if run.is_dir() else Path(f"{name}.arrow")


def _run_as(before: RunFolder, bench: Path) -> str:
    """Another bench file run as that run was: at its link, with what of it the file has otherwise."""
    was, declared = before.bench, load_bench(bench)
    link = None if before.result is None else before.result.link
    told = [] if link is None or link == _link_of(declared, bench) else [f"--link {shlex.quote(link)}"]
    loop = was.get("loop", {})
    for option, key in _OF_THE_LOOP.items():
        value = loop.get(key)
        if value is not None and value != getattr(declared.loop, key):
            told.append(f"{option} {value:.10g}" if isinstance(value, float) else f"{option} {value}")
    if declared.controller.enabled and was.get("controller", {}).get("enabled") is False:
        told.append("--open-loop")
    return " ".join(["hil run", _quoted(bench), *told])


def _link_of(declared: Bench, bench: Path) -> str | None:
    """The link of a bench file as a run has it."""
    url = declared.link.url
    try:
        return None if url is None else located(url, beside=bench)
    except InputError:  # its scenario is not beside this file
        return None


def _has_no_loop(device: Any) -> bool:
    """Whether it is a rate sensor, or an envelope was recorded: what is found there is declared in no bench file."""
    sense = device.get("sense", {})
    return bool(device.get("axes") == 0 or sense.get("senses") == "envelope")


def _used(place: Path, bench: Path, device: Any) -> str:
    """What one does with a record of which the model lacks nothing."""
    if not place.is_dir():
        return f"hil replay {_quoted(place)} --bench {_quoted(bench)}"
    return f"hil export {_quoted(place)} --what {'estimates' if device.get('axes') == 1 else 'angle'}"


def _traced(place: Path, bench: Path) -> str:
    return f"hil trace {_quoted(place)} --bench {_quoted(bench)}"


def _quoted(path: Path) -> str:
    return shlex.quote(str(path))
