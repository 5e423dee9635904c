"""Ground rules of every scenario section: no unknown keys, no silent conversions, finite numbers."""

import difflib
from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


class ScenarioError(ValueError):
    """A scenario that cannot be emulated. The message is one line: file, key, what was expected."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The remedy for a misspelt word: the nearest known one, or all of them."""
    known = list(known)
    near = difflib.get_close_matches(word, known, n=1)
    return f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"


class Section(BaseModel):
    """One table of a scenario file."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def as_tuple(value: Any) -> Any:
    """A TOML list as the tuple that strict fields expect."""
    return tuple(value) if isinstance(value, list) else value


def _both_axes(value: Any) -> Any:
    return (value, value) if isinstance(value, int | float) and not isinstance(value, bool) else as_tuple(value)


Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
PositiveOrInf = Annotated[float, Field(gt=0, allow_inf_nan=True)]

# [x, y], and the entries [xx, yy, xy] of a symmetric matrix.
Pair = Annotated[tuple[float, float], BeforeValidator(as_tuple)]
Stiffness = Annotated[tuple[Positive, Positive, float], BeforeValidator(as_tuple)]
Damping = Annotated[tuple[NonNegative, NonNegative, float], BeforeValidator(as_tuple)]

# A number for both axes, or [x, y].
PerAxis = Annotated[tuple[float, float], BeforeValidator(_both_axes)]
PerAxisPositive = Annotated[tuple[Positive, Positive], BeforeValidator(_both_axes)]
PerAxisNonNegative = Annotated[tuple[NonNegative, NonNegative], BeforeValidator(_both_axes)]
PerAxisPositiveOrInf = Annotated[tuple[PositiveOrInf, PositiveOrInf], BeforeValidator(_both_axes)]
