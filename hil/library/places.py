"""Where what is given lies: folders of runs and traces."""

from pathlib import Path
from typing import Any

from hil.errors.arguments import path_of
from hil.library.finished_run import Run
from hil.library.tracing import Trace
from hil.records.listing import named


def folder_of(argument: str, given: Any, wanted: str = "a Run, a Trace or the path of its folder") -> Path:
    """Where a run or a trace is kept; also a record file, by its path.  Raises InputError for anything else."""
    return given.path if isinstance(given, Run | Trace) else named(path_of(argument, given, wanted))
