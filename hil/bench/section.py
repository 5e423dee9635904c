"""Ground rules of every table of a bench file: known keys only, finite numbers, no silent conversion."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema

from hil.bench.field_units import in_model_units, other_keys

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
