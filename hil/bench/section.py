"""Ground rules of every table of a bench file: known keys only, finite numbers, no silent conversion."""

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
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


def check_matrix(key: str, letter: str, values: tuple[float, ...], axes: int) -> None:
    names = [f"{letter}xx", f"{letter}yy", f"{letter}xy"] if axes == 2 else [letter]
    if len(values) != len(names):
        raise ValueError(f"{key}: axes = {axes} needs [{', '.join(names)}], not {len(values)} of them")
