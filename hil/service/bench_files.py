"""Which files of a bench (bench, scenario, map, campaign) a request may name: those beside the runs and the examples.

A name is looked up in a list, and never made into a path.
"""

from pathlib import Path
from typing import Literal

from hil.bench import examples
from hil.errors import InputError
from hil.toml.reading import suggestion

Kind = Literal["bench", "scenario", "map", "campaign"]


def files(runs: Path, kind: Kind) -> dict[str, Path]:
    """Files of a kind by their names without the ending: examples, those beside the folder of runs, those in it; of one
    name the last is meant."""
    ending = f".{kind}.toml"
    folders = (examples.directory(), runs.resolve().parent, runs)
    return {
        path.name.removesuffix(ending): path
        for folder in folders
        for path in sorted(folder.glob(f"*{ending}"))
        if path.is_file() and not path.name.startswith(".")
    }


def found(runs: Path, kind: Kind, name: str) -> Path:
    """The file of that name, with or without its ending. Raises InputError where none is listed."""
    listed = files(runs, kind)
    bare = name.removesuffix(f".{kind}.toml")
    if bare not in listed:
        raise InputError(f"{name[:100]}: no {kind} file of this bench; {suggestion(bare[:100], list(listed))}")
    return listed[bare]
