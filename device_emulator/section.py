"""Ground rules of every scenario section: no unknown keys, no silent conversions, finite numbers."""

import difflib
import math
from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator


class ScenarioError(ValueError):
    """A scenario that cannot be emulated. The message is one line: file, key, what was expected."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The remedy for a misspelt word: the nearest known one, or all of them."""
    known = list(known)
    near = difflib.get_close_matches(word, known, n=1)
    return f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"


class Section(BaseModel):
    """One table of a scenario file."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )

    @classmethod
    def other_keys(cls) -> dict[str, str]:
        """Keys in degrees or °/s that stand for a field in rad or rad/s, each with that field."""
        ends = (("_rad_s", "_dps"), ("_rad", "_deg"))
        return {
            name.removesuffix(end) + other: name
            for name in cls.model_fields
            for end, other in ends
            if name.endswith(end)
        }

    @model_validator(mode="before")
    @classmethod
    def _in_radians(cls, table: Any) -> Any:
        if not isinstance(table, dict):
            return table
        others = cls.other_keys()
        if twice := next((other for other in others if other in table and others[other] in table), None):
            raise ValueError(f"{others[twice]}, {twice}: one quantity in two units; give one of them")
        return {others.get(key, key): _radians(value) if key in others else value for key, value in table.items()}


def _radians(degrees: Any) -> Any:
    """Of a number or a list of them; what is neither is left for the field to refuse."""
    if isinstance(degrees, list):
        return [_radians(one) for one in degrees]
    return degrees if isinstance(degrees, bool) or not isinstance(degrees, int | float) else math.radians(degrees)


def as_tuple(value: Any) -> Any:
    """A TOML list as the tuple that strict fields expect."""
    return tuple(value) if isinstance(value, list) else value


def both_axes(value: Any) -> Any:
    """One number for both axes, or a list of two."""
    return (value, value) if isinstance(value, int | float) and not isinstance(value, bool) else as_tuple(value)


Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
PositiveOrInf = Annotated[float, Field(gt=0, allow_inf_nan=True)]

# [x, y], and the entries [xx, yy, xy] of a symmetric matrix.
Pair = Annotated[tuple[float, float], BeforeValidator(as_tuple)]
Stiffness = Annotated[tuple[Positive, Positive, float], BeforeValidator(as_tuple)]
Damping = Annotated[tuple[NonNegative, NonNegative, float], BeforeValidator(as_tuple)]

# A number for both axes, or [x, y].
PerAxis = Annotated[tuple[float, float], BeforeValidator(both_axes)]
PerAxisPositive = Annotated[tuple[Positive, Positive], BeforeValidator(both_axes)]
PerAxisNonNegative = Annotated[tuple[NonNegative, NonNegative], BeforeValidator(both_axes)]
PerAxisPositiveOrInf = Annotated[tuple[PositiveOrInf, PositiveOrInf], BeforeValidator(both_axes)]
