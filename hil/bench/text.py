"""The bench file described: its sections and keys, its JSON Schema, its page of the reference.

``python -m hil.bench.text FOLDER`` writes ``bench.schema.json`` and ``bench.md``, which docs/reference keeps.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from hil.bench.bench import Bench
from hil.bench.rate_sensor import RateSensorBench

INTRODUCTION = """\
# Bench file

What the data sheet declares about a device, and how the bench is to treat it: TOML, UTF-8, SI units with the
unit in the key's name. Keys marked **required** must be given; unknown keys are errors. `bench.schema.json`
beside this page is the same as a JSON Schema. Both are generated: `python -m hil.bench.text docs/reference`.
"""


SENSOR = """
# Bench file of a rate-output sensor

A sensor that puts out a rate as a voltage has `[device] axes = 0`, and of the sections above only `[device]`, with
other keys; its schema is `rate-sensor.schema.json`. Its record has a reference for the rate in `rate_rad_s` and its
output in `vx_V`.
"""


def toml_value(value: Any) -> str:
    """A scalar or a list of scalars in TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(item) for item in value)}]"
    return repr(value)


def json_schema(file: type[BaseModel] = Bench) -> str:
    """The published JSON Schema (draft 2020-12) as text."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **file.model_json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def reference() -> str:
    """The reference page in Markdown: one table per section."""
    effects = " ".join((Bench.model_fields["effects"].description or "").split())
    parts = [INTRODUCTION, *_tables(Bench), f"\n## [effects.NAME]\n\n{effects}\n", SENSOR, *_tables(RateSensorBench)]
    return "".join(parts)


def _tables(file: type[BaseModel]) -> Iterator[str]:
    definitions = file.model_json_schema()["$defs"]
    for path, model in sections(file):
        yield f"\n## [{path}]\n\n{(model.__doc__ or '').strip()}\n"
        yield "\n| key | value | default | meaning |\n|---|---|---|---|\n"
        schema = definitions[model.__name__]["properties"]
        for key, field in keys(model):
            yield f"| `{key}` | {_kind(schema[key])} | {_default(field)} | {meaning(field)} |\n"


def sections(model: type[BaseModel], path: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """Every table below ``model`` with its dotted name, in the order of the file."""
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
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


def _kind(schema: dict[str, Any]) -> str:
    """The sort of value a key takes, in a few words, from its JSON Schema."""
    choices = [option for option in schema.get("anyOf", [schema]) if option.get("type") != "null"]
    if any("anyOf" in option or option.get("type") == "array" for option in choices):
        return "number or list"
    (option,) = choices
    if "const" in option or "enum" in option:
        return " · ".join(f"`{toml_value(value)}`" for value in option.get("enum", [option.get("const")]))
    words = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true, false"}
    bounds = (("exclusiveMinimum", ">"), ("minimum", "≥"), ("exclusiveMaximum", "<"), ("maximum", "≤"))
    limits = [f"{sign} {option[word]:g}" for word, sign in bounds if word in option]
    return " ".join([words[option["type"]], ", ".join(limits)]).strip()


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    return "–" if field.default is None else f"`{toml_value(field.default)}`"


def _write(folder: Path) -> None:
    (folder / "bench.schema.json").write_text(json_schema(), encoding="utf-8")
    (folder / "rate-sensor.schema.json").write_text(json_schema(RateSensorBench), encoding="utf-8")
    (folder / "bench.md").write_text(reference(), encoding="utf-8")


if __name__ == "__main__":
    _write(Path(sys.argv[1]))
