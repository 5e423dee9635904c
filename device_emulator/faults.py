"""`[faults]` of a scenario: what goes wrong on the line and inside the board, and when.

Probabilities are per frame and direction, times are bench time (tick 0 is 0 s). What befalls the line is carried
out by `device_emulator.line`, what befalls the sense chain by `device_emulator.sense`.
"""

import math
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from device_emulator.section import NonNegative, Positive, PositiveOrInf, Section, as_tuple

MAX_SENSE_FAULTS = 16

Share = Annotated[float, Field(ge=0, le=1)]
Bounds = Annotated[tuple[NonNegative, NonNegative], BeforeValidator(as_tuple)]


class Spell(Section):
    """A fault with a beginning and an end."""

    start_s: NonNegative
    """bench time at which it begins"""
    duration_s: Positive
    """how long it lasts"""


class Stuck(Spell):
    """The converter of one axis repeats its last code."""

    axis: Literal["x", "y"]
    """which channel"""


class Saturated(Stuck):
    """The amplifier of one axis reaches no further than ± `limit_V`, and says nothing about it."""

    limit_V: NonNegative
    """largest voltage that still comes out"""


class Faults(Section):
    """`[faults]`: nothing goes wrong unless it stands here."""

    lost: Share = 0.0
    """share of frames that never arrive"""
    corrupted: Share = 0.0
    """share of frames in which 1 to 4 bits flip"""
    duplicated: Share = 0.0
    """share of frames that arrive twice"""
    reordered: Share = 0.0
    """share of frames that the next one overtakes"""
    delayed: Share = 0.0
    """share of frames that take longer"""
    delay_s: Bounds = (0.0, 0.0)
    """by how much, [least, most]"""
    toward: Literal["both", "host", "board"] = "both"
    """direction that these befall"""
    from_s: NonNegative = 0.0
    """bench time at which they begin"""
    until_s: PositiveOrInf = math.inf
    """and end"""
    baud: Positive | None = None
    """of a serial line, ten bits to the byte; without it as fast as it goes"""
    unplugged_s: NonNegative | None = None
    """from here on the board's end of the line is gone"""
    clock_skew: Annotated[float, Field(gt=-0.1, lt=0.1)] = 0.0
    """by which the board's clock runs fast, relative"""
    stall: list[Spell] = Field(default_factory=list)
    """tables [[faults.stall]]: the line holds everything back, then lets it go"""
    brown_out: list[Spell] = Field(default_factory=list)
    """tables [[faults.brown_out]]: no supply; afterwards the board boots"""
    tripped: list[Spell] = Field(default_factory=list)
    """tables [[faults.tripped]]: the board's own protection: SAFE, FAULT, until it is over"""
    stuck: list[Stuck] = Field(default_factory=list)
    """tables [[faults.stuck]] with an axis: its converter repeats its last code"""
    saturated: list[Saturated] = Field(default_factory=list)
    """tables [[faults.saturated]] with an axis and limit_V: its amplifier reaches no further, and says nothing"""

    @model_validator(mode="after")
    def _possible(self) -> "Faults":
        if (harmed := self.lost + self.corrupted + self.duplicated + self.reordered + self.delayed) > 0.9:
            raise ValueError(f"{harmed:g} of the frames harmed: expected at most 0.9, or nothing ever arrives")
        if self.delay_s[0] > self.delay_s[1]:
            raise ValueError("delay_s: expected [least, most]")
        if self.delayed and not self.delay_s[1]:
            raise ValueError("delayed: delay_s says by how much; give it as [least, most]")
        if len(self.stuck) + len(self.saturated) > MAX_SENSE_FAULTS:
            raise ValueError(f"stuck, saturated: at most {MAX_SENSE_FAULTS} together")
        return self

    @property
    def on_the_line(self) -> bool:
        """Whether anything happens between board and link."""
        harmed = self.lost + self.corrupted + self.duplicated + self.reordered + self.delayed > 0.0
        return harmed or self.baud is not None or self.unplugged_s is not None or bool(self.stall or self.brown_out)
