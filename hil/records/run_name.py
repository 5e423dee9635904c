"""What a run may be called: its folder is named so, on every file system and in every shell."""

import re
from pathlib import Path
from typing import Annotated

from annotated_types import MaxLen

from hil.options import Help, Like

RUN_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"
RunNameOption = Annotated[
    Annotated[str, MaxLen(60), Like(RUN_NAME)] | None, Help("Last part of the run's name; by default the bench's.")
]
_MOST, _OF_A_FILE = 100, 60


def named_by(file: Path) -> str:
    """What a run is called by its bench file: the file's name without what says its kind."""
    stem = file.name.removesuffix(".toml").removesuffix(".bench")
    return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).lstrip("._-")[:_OF_A_FILE] or "bench"


def checked_name(name: str) -> str:
    """`name` itself.  Raises ValueError in words where no folder should be called so."""
    if re.fullmatch(RUN_NAME[1:-1], name) is None:
        raise ValueError(f"{name!r} is no name of a run; take letters, digits, '.', '-', '_', a letter or digit first")
    if len(name) > _MOST:
        raise ValueError(f"a name of {len(name)} letters; a run's has {_MOST} at most")
    return name
