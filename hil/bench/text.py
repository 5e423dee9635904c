"""The bench file described: its sections and keys, its JSON Schema, its page of the reference.

``python -m hil.bench.text FOLDER`` writes ``bench.schema.json`` and ``bench.md``, which docs/reference keeps.
"""

import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from estimator.custom.grammar import DEEPEST, FUNCTIONS, LARGEST_EXPONENT, LONGEST
from estimator.custom.names import QUANTITIES
from hil.bench.bench import Bench
from hil.bench.by_verb import page
from hil.bench.device import Device
from hil.bench.field_units import FIELD_UNITS, other_key
from hil.bench.modes import Modes
from hil.bench.own import Effects, OwnCoefficient, OwnEffect, OwnParameter
from hil.bench.rate_sensor import RateSensorBench
from hil.bench.section import Section
from hil.bench.toml import toml_value

INTRODUCTION = """\
# Bench file

A bench file declares a device by its data sheet, and sets how the bench treats it: TOML, UTF-8, SI units with the
unit in the key's name. Keys marked **required** must be given; unknown keys are errors. `bench.schema.json`
beside this page is the same as a JSON Schema. Both are generated: `python -m hil.bench.text docs/reference`.

Some keys may also be given in units that are usual for gyros. The end of the key names the unit:

| instead of | you may write | unit |
|---|---|---|
{units}
Give each quantity once: two keys for one quantity are refused, and the message names both. You may give [resonance, Q,
decay time and frequency split](#in-place-of-stiffness-and-damping) in `[device]` instead of stiffness and damping. A
run saves its bench file in SI units.
"""

MODES = """
### In place of stiffness and damping

These keys stand in `[device]`; `hil init --resonance 15000 --q 5000 --split 10 --mass 1e-8` writes a file with them. A
device with `resonance_Hz` = f and `split_Hz` = Δf resonates at f + Δf/2 along `azimuth_deg` and at f − Δf/2 across it.

| key | value | meaning |
|---|---|---|
"""


OWN = (
    ("effects.custom.NAME", OwnEffect),
    ("effects.custom.NAME.coefficients.SYMBOL", OwnCoefficient),
    ("effects.custom.NAME.parameters.SYMBOL", OwnParameter),
)

GRAMMAR = """
### Laws

A law has numbers, names, `+ - * / **`, parentheses and the functions {functions}
of one argument. It has at most {longest} characters and {deepest} levels of nesting; exponents are numbers up to
{exponent}. It is parsed, never executed; everything but arithmetic is refused. `force_x` and `force_y` are in m/s²,
`sense_x` and `sense_y` in m or in V. Units are checked: if they do not fit, the message says which unit the coefficient
should have. The unit of a coefficient has integer powers. [How to](../how-to.md#-add-an-effect-of-your-own).

| name | unit | what it is |
|---|---|---|
{names}
`abs`, `sqrt`, `r` and `v` are smoothed below 1e-9 of the amplitude; the root of a negative number is that of zero.
`sign(vx)` and `sign(vy)` are smoothed as tanh(v/v_rest). `v_rest` is then a parameter, 0.01 amplitude · omega0 unless
[effects.NAME] gives it. The sign of any other argument is smoothed within a hundredth of amplitude, omega0 and their
products.
"""

SENSOR = """
# Bench file of a rate-output sensor

A sensor that outputs a rate as a voltage has `[device] axes = 0`. Its bench file has only the section `[device]`, with
the keys below; its schema is `rate-sensor.schema.json`. Its record has a reference for the rate in `rate_rad_s` and its
output in `vx_V`.
"""


def json_schema(file: type[BaseModel] = Bench) -> str:
    """The published JSON Schema (draft 2020-12) as text."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **file.model_json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def reference() -> str:
    """The reference page in Markdown: one table per section."""
    effects = " ".join((Bench.model_fields["effects"].description or "").split())
    units = "".join(f"| `…{one.end}` | `…{one.other}` | {one.symbol} |\n" for one in FIELD_UNITS)
    parts = [INTRODUCTION.format(units=units), *_tables(Bench, sections(Bench)), f"\n## [effects.NAME]\n\n{effects}\n"]
    parts += [*_tables(Bench, OWN), _grammar(), page(), SENSOR, *_tables(RateSensorBench, sections(RateSensorBench))]
    return "".join(parts)


def _grammar() -> str:
    names = "".join(f"| `{name}` | {one.unit} | {one.meaning} |\n" for name, one in QUANTITIES.items())
    functions = ", ".join(f"`{name}`" for name in FUNCTIONS)
    return GRAMMAR.format(functions=functions, longest=LONGEST, deepest=DEEPEST, exponent=LARGEST_EXPONENT, names=names)


def _tables(file: type[BaseModel], listed: Iterable[tuple[str, type[BaseModel]]]) -> Iterator[str]:
    definitions = file.model_json_schema()["$defs"]
    for path, model in listed:
        yield f"\n## [{path}]\n\n{(model.__doc__ or '').strip()}\n"
        yield "\n| key | value | default | meaning |\n|---|---|---|---|\n"
        schema = definitions[model.__name__]["properties"]
        for key, field in keys(model):
            yield f"| `{key}` | {_kind(schema[key])} | {_default(field)} | {meaning(field)}{_in_field_units(key)} |\n"
        if model is Device:
            yield MODES
            for key, told in others(Device):
                yield f"| `{key}` | {_kind(schema[key])} | {told} |\n"


def others(model: type[BaseModel]) -> Iterator[tuple[str, str]]:
    """Keys that stand for more than another unit of a table's key, and what they mean."""
    if model is Device:
        for key, field in Modes.model_fields.items():
            yield key, meaning(field)


def _in_field_units(key: str) -> str:
    other = other_key(key)
    return "" if other is None else f"; or `{other.name}` in {other.symbol}"


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


def _kind(schema: dict[str, Any]) -> str:
    """The sort of value a key takes, in a few words, from its JSON Schema."""
    choices = [option for option in schema.get("anyOf", [schema]) if option.get("type") != "null"]
    if any("anyOf" in option or option.get("type") == "array" for option in choices):
        return "number or list"
    (option,) = choices
    if "const" in option or "enum" in option:
        return " · ".join(f"`{toml_value(value)}`" for value in option.get("enum", [option.get("const")]))
    if option.get("type") == "object":
        return "tables"
    words = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true, false"}
    bounds = (("exclusiveMinimum", ">"), ("minimum", "≥"), ("exclusiveMaximum", "<"), ("maximum", "≤"))
    limits = [f"{sign} {option[word]:g}" for word, sign in bounds if word in option]
    return " ".join([words[option["type"]], ", ".join(limits)]).strip()


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    if field.default_factory is not None:
        return "none"
    return "–" if field.default is None else f"`{toml_value(field.default)}`"


def _write(folder: Path) -> None:
    (folder / "bench.schema.json").write_text(json_schema(), encoding="utf-8")
    (folder / "rate-sensor.schema.json").write_text(json_schema(RateSensorBench), encoding="utf-8")
    (folder / "bench.md").write_text(reference(), encoding="utf-8")


if __name__ == "__main__":
    _write(Path(sys.argv[1]))
