"""The JSON files of a run, each one model of Pydantic, sealed."""

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from hil.errors import InputError
from hil.records.atomic import UNSEALED, read_json, require_unchanged, sealed, write_text


class Strict(BaseModel):
    """Part of such a file: no key but its own, no number but a finite one."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


class Sealed(Strict):
    """What is written as a sealed file."""

    seal: str = Field(default="", description="CRC-32C of the file, its eight digits being zero; older files have none")


Model = TypeVar("Model", bound=Sealed)


def save(path: Path, model: Sealed) -> None:
    """Write the file with its checksum, whole or not at all."""
    text = model.model_copy(update={"seal": UNSEALED}).model_dump_json(indent=2, by_alias=True)
    write_text(path, sealed(text + "\n"))


def load(path: Path, model: type[Model], *, give: str, anew: str) -> Model:
    """Read the file. Raises InputError naming it and the key that is wrong, or that it was changed since it was
    written, with the remedy: what to `give` in its place, how to have it `anew`.
    """
    try:
        data = read_json(path)
        require_unchanged(data, path, anew)
        return model.model_validate_json(data).model_copy(update={"seal": ""})
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give {give}") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"]) or "the whole file"
        raise InputError(f"{path}: {key}: {first['msg']}; {anew}") from None
