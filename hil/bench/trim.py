"""The trim electrodes that a bench file declares, and how they are used."""

from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from hil.bench.section import Numbers, Positive, Section, as_tuple


def _rows(value: Any) -> Any:
    return tuple(as_tuple(row) for row in value) if isinstance(value, list | tuple) else value


Rows = Annotated[
    tuple[tuple[float, float, float], ...],
    BeforeValidator(_rows),
    WithJsonSchema(
        {
            "type": "array",
            "items": {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
        }
    ),
]


class Trim(Section):
    """Trim electrodes: slow outputs of the board whose voltages soften the springs by their square."""

    electrodes: Annotated[tuple[str, ...], BeforeValidator(as_tuple), Field(max_length=8, examples=[("x", "y")])] = ()
    """names as the board tells them, of those that are used; the others stay at 0"""
    softening_N_per_m_per_V2: Rows = ()
    """[xx, yy, xy] that V² takes off the stiffness, one row per electrode"""
    softening_u: Numbers = (0.1,)
    """relative standard uncertainty of these, one number, or one per electrode"""
    control: bool = False
    """true: once the loop is closed and the springs are known, the electrodes null split and quadrature, and bring the
    springs as near to the target stiffness as softening can"""
    limit_V: Positive | None = None
    """largest magnitude that is put out; without it the board's own range"""
    ramp_V_per_s: Positive = 10.0
    """fastest change of a voltage"""
    time_constant_s: Positive = 0.5
    """in which the control takes off what is left"""
    period_s: Positive = 0.05
    """time between two settings of the voltages"""
    tolerance: Positive = 1e-5
    """what may be left, in units of the target stiffness: the voltages stand still within it, until it is thrice"""

    @model_validator(mode="after")
    def _rows_agree(self) -> Self:
        count = len(self.electrodes)
        if len(set(self.electrodes)) < count:
            raise ValueError("electrodes: a name stands there twice")
        if len(self.softening_N_per_m_per_V2) != count:
            given = len(self.softening_N_per_m_per_V2)
            raise ValueError(f"softening_N_per_m_per_V2: expected a row for each of {count} electrodes, not {given}")
        if not all(any(row) for row in self.softening_N_per_m_per_V2):
            raise ValueError("softening_N_per_m_per_V2: a row of zeros softens nothing; leave that electrode out")
        if (count and len(self.softening_u) not in (1, count)) or min(self.softening_u, default=0.0) < 0.0:
            raise ValueError("softening_u: expected one number, or one per electrode, none below 0")
        if self.control and not count:
            raise ValueError("control: there are no electrodes; name them, or set it to false")
        return self
