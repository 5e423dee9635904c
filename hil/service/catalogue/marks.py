"""Tags and a note that people give a run: `marks.json` in its folder, where they outlive the catalogue."""

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from hil.errors import InputError
from hil.records.atomic import read_json, write_text

FILE = "marks.json"
Tag = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=60, pattern=r"^[^\x00-\x1f\x7f]+$")
]


class Marks(BaseModel):
    """What people say of a run."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    version: int = Field(default=1, ge=1, le=1)
    tags: tuple[Tag, ...] = Field(default=(), max_length=50)
    note: Annotated[str, StringConstraints(max_length=10_000)] | None = Field(
        default=None, description="Stands for the operator's note of result.json; null where that one is meant"
    )


def read_marks(folder: Path) -> Marks:
    """Those of a run; none where there is no file. Raises InputError where it is no file of marks."""
    path = folder / FILE
    try:
        return Marks.model_validate_json(read_json(path))
    except FileNotFoundError:
        return Marks()
    except (OSError, ValidationError, ValueError):
        raise InputError(f"{path}: tags and note cannot be read; correct or remove the file") from None


def write_marks(folder: Path, marks: Marks) -> None:
    """Write them, whole or not at all; no file is left where there is nothing to say."""
    path = folder / FILE
    if marks == Marks():
        path.unlink(missing_ok=True)
    else:
        write_text(path, marks.model_dump_json(indent=1) + "\n")
