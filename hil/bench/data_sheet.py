"""The figures of a gyro's data sheet: what each is called, in which unit, by which clause, and the limit a bench file
may set to it.

One declaration, of which the table of `hil characterise`, the columns of a comparison and of a campaign, the keys of
[limits] and the reference page are made.
"""

from typing import Any, NamedTuple, TypeVar

from pydantic import Field, create_model

from hil.bench.section import OtherKey, Positive, Section, other_keys

_Table = TypeVar("_Table", bound=type[Section])


class SheetFigure(NamedTuple):
    """`end` is the end of its key, which has the unit; `unit` is the model's; clause: where it is defined."""

    name: str
    title: str
    end: str
    unit: str
    clause: str

    @property
    def key(self) -> str:
        """Its key in [limits], and its column."""
        return f"{self.name}{self.end}"

    @property
    def short(self) -> str:
        """The field's name for it, where a table is narrow."""
        return _SHORT.get(self.name, self.title)

    @property
    def field(self) -> OtherKey:
        """The unit that a data sheet has it in."""
        found = other_keys(self.key)
        return found[-1] if found else OtherKey(self.key, 1.0, self.unit)

    def shown(self, value: float) -> float:
        """`value`, in the model's unit, in the data sheet's."""
        return value * self.field.per_model_unit


_1431, _952 = "IEEE Std 1431", "IEEE Std 952"
HARMONICS = (1, 2, 3, 4)
_SHORT = {
    "scale_factor_error": "SF error", "scale_factor_nonlinearity": "SF non-lin.", "scale_factor_asymmetry": "SF asym.",
    "bias_turn_on": "turn-on bias", "quantisation": "QN", "angle_random_walk": "ARW", "bias_instability": "BI",
    "rate_random_walk": "RRW", "rate_ramp": "RR", "bandwidth": "BW", "bias_temperature": "bias/K",
    "scale_factor_temperature": "SF/K", "start_up": "start-up",
}  # fmt: skip

FIGURES: tuple[SheetFigure, ...] = (
    SheetFigure("scale_factor_error", "scale factor error", "_rel", "1", _1431),
    SheetFigure("scale_factor_nonlinearity", "scale factor non-linearity", "_rel", "1", _1431),
    SheetFigure("scale_factor_asymmetry", "scale factor asymmetry", "_rel", "1", _1431),
    SheetFigure("bias", "bias", "_rad_s", "rad/s", _1431),
    SheetFigure("bias_turn_on", "bias, turn-on to turn-on", "_rad_s", "rad/s", _1431),
    SheetFigure("quantisation", "quantisation noise", "_rad", "rad", f"{_952}, C.1.5"),
    SheetFigure("angle_random_walk", "angle random walk", "_rad_per_rts", "rad/√s", f"{_952}, C.1.1"),
    SheetFigure("bias_instability", "bias instability", "_rad_s", "rad/s", f"{_952}, C.1.2"),
    SheetFigure("rate_random_walk", "rate random walk", "_rad_s_per_rts", "rad/s/√s", f"{_952}, C.1.3"),
    SheetFigure("rate_ramp", "rate ramp", "_rad_s2", "rad/s²", f"{_952}, C.1.4"),
    SheetFigure("bandwidth", "bandwidth, −3 dB", "_Hz", "Hz", _1431),
    SheetFigure("delay", "delay", "_s", "s", _1431),
    SheetFigure("threshold", "threshold", "_rad_s", "rad/s", _1431),
    SheetFigure("dead_zone", "dead zone", "_rad_s", "rad/s", _1431),
    SheetFigure("bias_temperature", "bias over temperature", "_rad_s_per_K", "rad/s/K", _1431),
    SheetFigure("scale_factor_temperature", "scale factor over temperature", "_rel_per_K", "1/K", _1431),
    SheetFigure("start_up", "start-up time", "_s", "s", _1431),
    *(SheetFigure(f"bias_{k}theta", f"bias over the angle, {k}θ", "_rad_s", "rad/s", _1431) for k in HARMONICS),
    *(
        SheetFigure(f"scale_factor_{k}theta", f"scale factor over the angle, {k}θ", "_rel", "1", _1431)
        for k in HARMONICS
    ),
)  # fmt: skip
BY_NAME = {figure.name: figure for figure in FIGURES}
AT_LEAST = ("bandwidth",)
"""Figures of which more is better; of all others the size is limited."""


def with_sheet_limits(table: _Table) -> _Table:
    """A decorator for [limits]: it has a key for each figure as well."""
    fields: dict[str, Any] = {
        one.key: (Positive | None, Field(None, description=f"{_bound(one)} {one.title}, of `hil characterise`"))
        for one in FIGURES
    }
    return create_model(  # type: ignore[return-value]
        table.__name__, __base__=table, __module__=table.__module__, __doc__=table.__doc__, **fields
    )


def _bound(figure: SheetFigure) -> str:
    return "least" if figure.name in AT_LEAST else "largest"


@with_sheet_limits
class SensorLimits(Section):
    """Limits that a sensor's data sheet sets."""
