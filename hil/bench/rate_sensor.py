"""A sensor that puts out a rate as a voltage, as its data sheet describes it."""

from typing import Annotated, Literal

from pydantic import Field

from hil.bench.data_sheet import SensorLimits
from hil.bench.section import NotNegative, Positive, Section


class RateSensor(Section):
    """A rate-output sensor: a static curve and a response; its oscillator cannot be observed."""

    name: str
    """what the device is called in reports"""
    axes: Literal[0]
    """0: a rate-output sensor"""
    scale_V_s_per_rad: float
    """scale factor, signed: volts per rad/s (57.3 times volts per °/s)"""
    scale_tolerance: Annotated[float, Field(gt=0, le=1)] = 0.1
    """how far the scale factor of a good sensor may be from it, as a fraction"""
    offset_V: float = 0.0
    """output at rest"""
    offset_tolerance_V: Positive | None = None
    """how far the output of a good sensor at rest may be from it; without it a tenth of what full rate adds"""
    unit: Annotated[str, Field(min_length=1, max_length=16)] = "V"
    """unit to read for V in this table, if the output has its own: LSB, deg/s; the same as in the record"""
    range_rad_s: Positive
    """largest rate for which the data sheet guarantees the scale factor"""
    noise_V: Positive
    """rms noise of one sample of the output"""
    sample_rate_Hz: NotNegative = 0.0
    """rate of the samples; 0 for tables of steady states"""


class RateSensorBench(Section):
    """The bench file of a rate-output sensor."""

    device: RateSensor
    """table [device]"""
    limits: SensorLimits = SensorLimits()
    """table [limits]"""
