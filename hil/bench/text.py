"""The tables and keys of a bench file, and what they mean: for its page of the reference and for files of one's own."""

from collections.abc import Iterator

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from hil.bench.device import Device
from hil.bench.modes import Modes
from hil.bench.own import Effects
from hil.bench.section import Section


def others(model: type[BaseModel]) -> Iterator[tuple[str, str]]:
    """Keys that stand for more than another unit of a table's key, and what they mean."""
    if model is Device:
        for key, field in Modes.model_fields.items():
            yield key, meaning(field)


def sections(model: type[BaseModel], path: str = "") -> Iterator[tuple[str, type[Section]]]:
    """Every table below ``model`` with its dotted name, in the order of the file."""
    for name, field in model.model_fields.items():
        if field.annotation is Effects:  # its tables have names of their own
            continue
        if isinstance(field.annotation, type) and issubclass(field.annotation, Section):
            below = f"{path}.{name}" if path else name
            yield below, field.annotation
            yield from sections(field.annotation, below)


def keys(model: type[BaseModel]) -> Iterator[tuple[str, FieldInfo]]:
    """The keys of one table that are not tables themselves."""
    for name, field in model.model_fields.items():
        if not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
            yield name, field


def meaning(field: FieldInfo) -> str:
    """A key's description on one line."""
    return " ".join((field.description or "").split())
