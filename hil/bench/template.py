"""A bench file to start from: every key with its meaning, filled in as far as something is known."""

from collections.abc import Mapping
from typing import Any

from hil.bench.bench import Bench
from hil.bench.own import own_table
from hil.bench.text import keys, meaning, sections
from hil.bench.toml import toml_key, toml_value

Values = Mapping[str, Mapping[str, Any]]

EFFECTS, CUSTOM = "effects", "effects.custom"
_COLUMN = 44  # where the remarks begin


def template(known: Values, heading: str) -> str:
    """A bench file with ``known`` values by section (``device.drive``) and key, and a first remark.

    Keys that are not known stand as remarks: optional ones with their default, required ones to be filled in.
    """
    lines = [f"# {heading}"]
    for path, model in sections(Bench):
        lines += ["", f"[{path}]"]
        given = known.get(path, {})
        for key, field in keys(model):
            if given.get(key) is not None:
                lines.append(_remarked(f"{key} = {toml_value(given[key])}", meaning(field)))
            elif field.is_required():
                lines.append(_remarked(f"# {key} =", f"REQUIRED: {meaning(field)}"))
            else:
                default = "" if field.default is None else f" {toml_value(field.default)}"
                lines.append(_remarked(f"# {key} ={default}", meaning(field)))
    for name, coefficients in known.get(EFFECTS, {}).items():
        lines += ["", f"[{EFFECTS}.{toml_key(name)}]"]
        lines += [f"{toml_key(key)} = {toml_value(value)}" for key, value in coefficients.items()]
    for name, own in known.get(CUSTOM, {}).items():
        lines += ["", *own_table(name, own)]
    return "\n".join(lines) + "\n"


def missing(known: Values) -> list[str]:
    """Required keys that ``known`` lacks, as ``[section] key``."""
    return [
        f"[{path}] {key}"
        for path, model in sections(Bench)
        for key, field in keys(model)
        if field.is_required() and key not in known.get(path, {})
    ]


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
