"""Where what is given lies: paths, folders of runs and traces, bench files."""

import os
from pathlib import Path
from typing import Any

from hil.errors import InputError
from hil.library.finished_run import Run
from hil.library.tracing import Trace
from hil.records.listing import named


def require(argument: str, given: object, kind: Any, wanted: str) -> None:
    """InputError that names the argument where what is given is not of that kind, as isinstance has it; `wanted` is
    what that is called.
    """
    if not isinstance(given, kind):
        raise InputError(f"{argument}: expected {wanted}, not {'None' if given is None else type(given).__name__}")


def path_of(argument: str, given: Any, wanted: str = "a path") -> Path:
    """What is given, as a path.  Raises InputError where it is none."""
    require(argument, given, str | os.PathLike, wanted)
    return Path(given)


def folder_of(argument: str, given: Any, wanted: str = "a Run, a Trace or the path of its folder") -> Path:
    """Where a run or a trace is kept; also a record file, by its path.  Raises InputError for anything else."""
    return given.path if isinstance(given, Run | Trace) else named(path_of(argument, given, wanted))


def bench_file(
    argument: str, given: Any, wanted: str = "a Bench, the path of a bench file or the name of an example"
) -> Path:
    """The bench file at a path, or the example of that name.  Raises InputError where there is none."""
    from hil.bench import examples  # knows what a file of TOML may hold, which a run that is opened does without

    return examples.find("bench", str(path_of(argument, given, wanted)))
