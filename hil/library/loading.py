"""What is there already is opened at once: neither estimator nor bench files are loaded for it."""

from pathlib import Path
from typing import Any

from hil.errors import InputError
from hil.errors.input import path_of
from hil.library.finished_run import Run
from hil.library.keywords import said_of_arguments
from hil.library.tracing import Trace
from hil.records.listing import named, named_trace
from hil.records.runfolder import RunFolder


@said_of_arguments
def load(run: Run | Path | str) -> Run:
    """The run in a folder; `last` is the newest in runs/.  Raises InputError where there is none, or a trace."""
    folder = folder_of("run", run, "a Run or the path of its folder")
    if (folder / "diagnosis.json").exists():
        raise InputError(f"{folder}: a trace, no run; hil.load_trace opens it")
    return Run(RunFolder.open(folder))


@said_of_arguments
def load_trace(trace: Trace | Path | str) -> Trace:
    """The trace in a folder; `last` is the newest in runs/.  Raises InputError where there is none, or a run."""
    from hil.records.diagnosis import load_diagnosis  # knows the estimator's words, which a run does without

    given = trace.path if isinstance(trace, Trace) else trace
    folder = named_trace(path_of("trace", given, "a Trace or the path of its folder"))
    if not (folder / "diagnosis.json").exists():
        if RunFolder(folder).capture_path.exists():
            raise InputError(f"{folder}: a run, no trace; hil.load opens it, hil.trace traces it")
        raise InputError(f"{folder}: no trace; give the folder that hil trace made")
    return Trace(folder, load_diagnosis(folder / "diagnosis.json"))


def folder_of(argument: str, given: Any, wanted: str = "a Run, a Trace or the path of its folder") -> Path:
    """Where a run or a trace is kept; also a record file, by its path.  Raises InputError for anything else."""
    return given.path if isinstance(given, Run | Trace) else named(path_of(argument, given, wanted))
