"""A bench file to start from: every key with its meaning, filled in as far as something is known."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from hil.bench.bench import Bench
from hil.bench.device import Device
from hil.bench.effects import Effects, own_table
from hil.bench.modes import Modes
from hil.bench.section import Section, other_keys
from hil.records.units import unit_of
from hil.toml.reading import toml_key, toml_value

Values = Mapping[str, Mapping[str, Any]]

EFFECTS, CUSTOM = "effects", "effects.custom"
IN_MPS2: Mapping[str, Any] = {"unit": "mps2", "gain_N_per_V": None}
"""Keys of [device.drive] that go with a full scale in m/s², as a board states it."""
NO_REMARKS: Mapping[tuple[str, str], str] = {}
_COLUMN = 44  # where the remarks begin


def template(known: Values, heading: str, remarks: Mapping[tuple[str, str], str] = NO_REMARKS) -> str:
    """A bench file with ``known`` values by section (``device.drive``) and key, and a first remark; `remarks`: what is
    said of a key, by section and key, before its meaning.

    Keys that are not known stand as remarks: optional ones with their default, required ones to be filled in.
    """
    lines = [f"# {heading}"]
    for path, model in sections(Bench):
        lines += ["", f"[{path}]"]
        given = known.get(path, {})
        for key, field in keys(model):
            said = f"{remarks[path, key]}; " if (path, key) in remarks else ""
            if given.get(key) is not None:
                lines.append(_remarked(f"{key} = {toml_value(given[key])}", said + meaning(field)))
            elif other := next((one.name for one in other_keys(key) if given.get(one.name) is not None), ""):
                lines.append(_remarked(f"{other} = {toml_value(given[other])}", meaning(field)))
            elif _in_another_way(model, key, given):
                lines.append(_remarked(f"# {key} =", f"given below: {meaning(field)}"))
            elif field.is_required():
                lines.append(_remarked(f"# {key} =", _required(key, field)))
            else:
                default = "" if field.default is None else f" {toml_value(field.default)}"
                lines.append(_remarked(f"# {key} ={default}", said + meaning(field)))
        for name, told in others(model):
            if name in given:
                lines.append(_remarked(f"{name} = {toml_value(given[name])}", told))
            elif not _all_given(model, given):
                lines.append(_remarked(f"# {name} =", told))
    for name, coefficients in known.get(EFFECTS, {}).items():
        lines += ["", f"[{EFFECTS}.{toml_key(name)}]"]
        lines += [f"{toml_key(key)} = {toml_value(value)}" for key, value in coefficients.items()]
    for name, own in known.get(CUSTOM, {}).items():
        lines += ["", *own_table(name, own)]
    return "\n".join(lines) + "\n"


def put_in(known: Values, changes: Values) -> dict[str, dict[str, Any]]:
    """``known`` with ``changes``: a key of theirs replaces any that stands for the same, None takes one out."""
    merged = {path: dict(table) for path, table in known.items()}
    models = dict(sections(Bench))
    for path, table in changes.items():
        others = models[path].other_keys()
        given = {others.get(key, key) for key in table}
        kept = {key: value for key, value in merged.get(path, {}).items() if others.get(key, key) not in given}
        merged[path] = kept | {key: value for key, value in table.items() if value is not None}
    return merged


def missing(known: Values) -> list[str]:
    """Required keys that ``known`` lacks, as ``[section] key``."""
    return [
        f"[{path}] {key}"
        for path, model in sections(Bench)
        for key, field in keys(model)
        if field.is_required()
        and key not in known.get(path, {})
        and not _in_another_way(model, key, known.get(path, {}))
    ]


def _in_another_way(model: type[Section], key: str, given: Mapping[str, Any]) -> bool:
    """Whether `given` has another key that stands for this one."""
    return any(name in given for name, stands_for in model.other_keys().items() if stands_for == key)


def _all_given(model: type[Section], given: Mapping[str, Any]) -> bool:
    """Whether each key that the `others` of a table can stand for is there itself: then they would be a second way."""
    names = dict(others(model))
    return all(given.get(key) is not None for name, key in model.other_keys().items() if name in names)


def _required(key: str, field: FieldInfo) -> str:
    """What a required key is, its unit and an example."""
    unit = unit_of(key)
    examples = "".join(f"; e.g. {toml_value(one)}" for one in field.examples or ())
    return f"REQUIRED{f', {unit}' if unit else ''}: {meaning(field)}{examples}"


def values_of(bench: Bench) -> dict[str, dict[str, Any]]:
    """All that ``bench`` says, defaults included, by section, as `template` takes it.

    A run's own bench file has to stay what it was when a default changes.
    """
    said: dict[str, dict[str, Any]] = {}
    for path, model in sections(Bench):
        table: Any = bench
        for part in path.split("."):
            table = getattr(table, part)
        given = {key: getattr(table, key) for key, _ in keys(model)}
        said[path] = {key: value for key, value in given.items() if value is not None}
    said[EFFECTS] = dict(bench.effects.named)
    said[CUSTOM] = dict(bench.effects.custom)
    return said


def _remarked(line: str, remark: str) -> str:
    return f"{line.ljust(_COLUMN)}  # {remark}"


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
