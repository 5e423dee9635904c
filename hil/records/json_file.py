"""The JSON files of a run, each one model of Pydantic."""

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from hil.errors import InputError
from hil.records.atomic import read_json, write_text

Model = TypeVar("Model", bound=BaseModel)


def save(path: Path, model: BaseModel, *, by_alias: bool = False) -> None:
    """Write the file, whole or not at all."""
    write_text(path, model.model_dump_json(indent=2, by_alias=by_alias) + "\n")


def load(path: Path, model: type[Model], *, give: str, anew: str) -> Model:
    """Read the file. Raises InputError naming it and the key that is wrong, with the remedy: what to `give` in its
    place, how to have it `anew`.
    """
    try:
        return model.model_validate_json(read_json(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give {give}") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"]) or "the whole file"
        raise InputError(f"{path}: {key}: {first['msg']}; {anew}") from None
