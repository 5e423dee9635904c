"""What another package brings by an entry point: loaded, or one line."""

from importlib.metadata import EntryPoint
from typing import Any

from hil.errors.input import InputError


def loaded(entry: EntryPoint, asked: str) -> Any:
    """The object of an entry point; `asked`: what needs it, as an error begins.  Raises InputError."""
    try:
        return entry.load()
    except Exception as error:  # whatever another package does wrong
        raise InputError(
            f"{asked}: {entry.value} cannot be loaded: {error}; mend or remove the package that brings it"
        ) from error
