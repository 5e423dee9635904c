"""Units of the field beside those of the model: `rate_dps` for `rate_rad_s`, `angle_deg` for `angle_rad`, ppm.

A key's unit is the end of its name. The table below gives the other ends that a key may have and what one of that unit
is in the model's; it holds for every key of every table of a bench file.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo


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
