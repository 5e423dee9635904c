"""Ground rules of every table of a bench file: known keys only, finite numbers, no silent conversion.

Units of the field beside those of the model: `rate_dps` for `rate_rad_s`, `angle_deg` for `angle_rad`, ppm.

A key's unit is the end of its name. The table below gives the other ends that a key may have and what one of that unit
is in the model's; it holds for every key of every table of a bench file.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Plugin = Annotated[str, Field(min_length=1, max_length=1000)] | None
Fraction = Annotated[float, Field(gt=0, le=1)]


def as_tuple(value: Any) -> Any:
    """TOML arrays become tuples, a lone number a tuple of one; the rest is for pydantic to refuse."""
    if isinstance(value, list):
        return tuple(value)
    return (value,) if isinstance(value, (int, float)) and not isinstance(value, bool) else value


Numbers = Annotated[
    tuple[float, ...],
    BeforeValidator(as_tuple),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}, "minItems": 1}]}),
]


class Section(BaseModel):
    """One table of the file: unknown keys are errors, numbers are finite, nothing changes after reading."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )

    @classmethod
    def other_keys(cls) -> dict[str, str]:
        """Keys that the table takes beside its fields, each with the field that it stands for."""
        return {other.name: name for name in cls.model_fields for other in other_keys(name)}

    @model_validator(mode="before")
    @classmethod
    def _in_model_units(cls, table: Any) -> Any:
        return in_model_units(table, cls.model_fields) if isinstance(table, Mapping) else table

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        schema = handler(core)
        table = handler.resolve_ref_schema(schema)
        for name in cls.model_fields:
            others = {
                other.name: {"type": "number", "description": f"`{name}` in {other.symbol}"}
                for other in other_keys(name)
            }
            if others and name in table.get("properties", {}):
                offer_instead(table, name, others)
        return schema


def offer_instead(table: dict[str, Any], key: str, others: Mapping[str, Mapping[str, Any]]) -> None:
    """Add to the JSON Schema of a table keys of which one may stand for `key`; exactly one where `key` is required."""
    table["properties"] |= others
    ways = [{"required": [name]} for name in (key, *others)]
    required = table.get("required", [])
    if key in required:
        table["required"] = [name for name in required if name != key]
        rule: dict[str, Any] = {"oneOf": ways}
    else:
        rule = {"oneOf": [*ways, {"not": {"anyOf": ways}}]}
    table.setdefault("allOf", []).append(rule)


def check_matrix(key: str, letter: str, values: tuple[float, ...], axes: int) -> None:
    names = [f"{letter}xx", f"{letter}yy", f"{letter}xy"] if axes == 2 else [letter]
    if len(values) != len(names):
        raise ValueError(f"{key}: axes = {axes} needs [{', '.join(names)}], not {len(values)} of them")


class FieldUnit(NamedTuple):
    """The end of a key in the model's unit and in the field's, how many of the second make one of the first, and the
    second as one writes it."""

    end: str
    other: str
    per_model_unit: float
    symbol: str


_DEGREES = 180.0 / math.pi
FIELD_UNITS = (  # the longest end first: one is the end of another
    FieldUnit("_rad_s_per_rts", "_dps_per_rts", _DEGREES, "°/s per √s"),
    FieldUnit("_rad_s_per_rts", "_deg_per_h_per_rth", _DEGREES * 3600.0 * 60.0, "°/h per √h"),
    FieldUnit("_rad_s_per_K", "_deg_per_h_per_K", _DEGREES * 3600.0, "°/h per K"),
    FieldUnit("_rad_per_rts", "_deg_per_rth", _DEGREES * 60.0, "°/√h"),
    FieldUnit("_rel_per_K", "_ppm_per_K", 1e6, "ppm/K"),
    FieldUnit("_V_s_per_rad", "_V_per_dps", 1.0 / _DEGREES, "V per °/s"),
    FieldUnit("_rad_s2", "_deg_per_h2", _DEGREES * 3600.0**2, "°/h per h"),
    FieldUnit("_rad_s", "_dps", _DEGREES, "°/s"),
    FieldUnit("_rad_s", "_deg_per_h", _DEGREES * 3600.0, "°/h"),
    FieldUnit("_rad", "_deg", _DEGREES, "°"),
    FieldUnit("_u", "_u_ppm", 1e6, "ppm"),
    FieldUnit("_rel", "_ppm", 1e6, "ppm"),
)


class OtherKey(NamedTuple):
    """A key in the field's unit: its name, how many of it make one of the model's unit, the unit as one writes it."""

    name: str
    per_model_unit: float
    symbol: str


def other_keys(key: str) -> tuple[OtherKey, ...]:
    """How else `key` may be given.

    >>> [other.name for other in other_keys("rate_rad_s")], other_keys("memory_s")
    (['rate_dps', 'rate_deg_per_h'], ())
    """
    end = next((unit.end for unit in FIELD_UNITS if key.endswith(unit.end)), None)
    return tuple(
        OtherKey(key.removesuffix(unit.end) + unit.other, unit.per_model_unit, unit.symbol)
        for unit in FIELD_UNITS
        if unit.end == end
    )


def in_model_units(table: Mapping[str, Any], fields: Mapping[str, FieldInfo]) -> dict[str, Any]:
    """`table` with every key of the field's units as the key of `fields` that it stands for.

    Raises ValueError that names the key: given in both units, no number, or outside what the key takes.
    """
    converted = dict(table)
    for key, field in fields.items():
        given = key if key in converted else None
        for other in other_keys(key):
            if other.name not in converted:
                continue
            if given is not None:
                raise ValueError(f"{given}, {other.name}: one quantity in two units; give one of them")
            given, value = other.name, converted.pop(other.name)
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"{other.name}: expected a number, not {value!r:.40}")
            converted[key] = _within(value / other.per_model_unit, field, f"{other.name}: {value:g} ({key} = {{:g}})")
    return converted


def _within(value: float, field: FieldInfo, told: str) -> float:
    """`value` where the key takes it; the error names the key as given, not the one that it stands for."""
    try:
        bounded: Any = Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
        TypeAdapter(bounded).validate_python(value)
    except ValidationError as error:
        raise ValueError(f"{told.format(value)} {error.errors()[0]['msg'].removeprefix('Input ')}") from None
    if not math.isfinite(value):
        raise ValueError(f"{told.format(value)} should be a finite number")
    return value
