"""The tables of a bench file together, and what they come to: what its checks look at."""

import math
from fractions import Fraction
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from hil.bench.device import Device
from hil.bench.effects import Effects
from hil.bench.loop import Controller, Limits, Link, Loop, Reference
from hil.bench.observer import Observer
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


_WATCHDOG_S, _MEMORY_S, _MEMORY_CYCLES = 0.02, 1.0, 10.0  # where a bench file says nothing


class Tables(Section):
    """The tables, each checked by itself."""

    link: Link = Link()
    """table [link]"""
    device: Device
    """table [device]"""
    reference: Reference = Reference()
    """table [reference]"""
    loop: Loop = Loop()
    """table [loop]"""
    observer: Observer = Observer()
    """table [observer]"""
    controller: Controller = Controller()
    """table [controller]"""
    limits: Limits = Limits()
    """table [limits]"""
    trim: Trim = Trim()
    """table [trim]"""
    effects: Effects = Field(default_factory=lambda: Effects.model_validate({}))
    """Effects that the base model lacks and that the observer includes: one table per effect with initial values of its
    coefficients, in SI per unit mass (0 where not given). The effects and their coefficients are in effects.md."""

    @property
    def watchdog_s(self) -> float:
        """Silence after which the board goes SAFE."""
        return max(_WATCHDOG_S, self.shortest_watchdog_s) if self.link.watchdog_s is None else self.link.watchdog_s

    @property
    def shortest_watchdog_s(self) -> float:
        """Least silence that a watchdog can tell from a block's pause."""
        least = 3 * self.loop.block if self.loop.in_blocks else 2
        return least / self.device.sample_rate_Hz

    @property
    def memory_s(self) -> float:
        """Time constant of the fading memory."""
        if self.observer.memory_s is not None:
            return self.observer.memory_s
        return max(_MEMORY_S, _MEMORY_CYCLES * self.cycle_s if self.device.resonance_Hz > 0.0 else 0.0)

    @property
    def cycle_s(self) -> float:
        """Of the controlled oscillator."""
        return math.tau / math.sqrt(self.target_stiffness_per_s2)

    @property
    def target_stiffness_per_s2(self) -> float:
        """Stiffness of the controlled oscillator per unit mass, 1/s²; its root is the scale of time."""
        device, target = self.device, self.controller.target_stiffness_N_per_m
        diagonal = device.stiffness_N_per_m[: device.axes]
        if target is None:
            target = min(diagonal) if self.trim.control else sum(diagonal) / len(diagonal)
        return target / device.mass_kg

    @property
    def swing_V(self) -> tuple[float, ...]:
        """Declared amplitude at the sense output of each axis, whatever it senses."""
        device, omega0 = self.device, math.sqrt(self.target_stiffness_per_s2)
        per_m, sense = omega0**device.sense.order, device.sense.interface.map(device.axes, omega0)
        ends = ([-device.amplitude_m, device.amplitude_m],) * device.axes
        shown = [float(abs(sense.shown(axis, both)).max()) for axis, both in enumerate(ends)]
        return tuple(abs(gain) * per_m * m for gain, m in zip(device.sense_gains_V_per_m, shown, strict=True))

    @property
    def drive_limit_mps2(self) -> Fraction:
        """Largest drive that a board may be asked for: the drive's full scale, or the controller's limit below it."""
        full, limit = self.device.drive_full_scale_mps2, self.controller.force_limit_mps2
        return full if limit is None else min(full, Fraction(limit))

    @property
    def virtual_reversal_s(self) -> float:
        """Time between reversals of the virtual rotation, 0: never; in gain mode half of it is whole blocks, as a
        matrix is in force for one.
        """
        period = self.controller.virtual_reversal_s
        if self.loop.mode != "gain" or period == 0.0:
            return period
        block = self.loop.block / self.device.sample_rate_Hz
        return max(round(0.5 * period / block), 1) * 2.0 * block

    @property
    def offset_sd_V(self) -> float:
        """Standard deviation of the initial value of the sense offsets."""
        own = self.observer.initial_sd.offset_V
        return self.device.sense.offset_sd_V if own is None else own

    @property
    def damping_sd_per_s(self) -> float:
        """Standard deviation of each of the declared dxx, dyy and dxy."""
        return self.observer.initial_sd.damping * sum(self.device.damping_per_s[:2]) / 2.0
