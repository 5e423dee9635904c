"""What is given to a function: of the kind that is wanted, or one line that names the argument."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hil.errors.input import InputError


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


def names_of(argument: str, given: str | Sequence[str]) -> tuple[str, ...]:
    """One name or several.  Raises InputError for anything else."""
    if isinstance(given, str):
        return (given,)
    require(argument, given, Sequence, "a name or a list of names")
    for one in given:
        require(argument, one, str, "names")
    return tuple(given)
