"""The device as its data sheet describes it: oscillator, sense chain, drive chain."""

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Annotated, Any, Literal, Self

from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from hil.bench.calibration import Calibration, Known
from hil.bench.interface import Interface
from hil.bench.modes import STANDS_BESIDE, STANDS_FOR, Modes, in_stiffness_and_damping
from hil.bench.section import NotNegative, Numbers, Positive, Section, check_matrix, offer_instead
from hil.records.units import LEVELS

DriveUnit = Literal["mps2", "N", "V"]
_LOGARITHMIC = ("db", "np", "neper", "bel")


class Sense(Section):
    """The sense chain: voltage per displacement, offset and noise."""

    gain_V_per_m: Numbers = Field(examples=[-1e6])
    """volts per metre at the sense output, signed; one number, or one per axis; volts per m/s or per m/s² if `senses`
    says so; for an envelope in dB, dBV or another level: reference units (0 dB) per metre"""
    senses: Literal["displacement", "velocity", "acceleration", "envelope"] = "displacement"
    """what the channel measures; with two axes displacement or velocity (the current of a piezoelectric readout);
    envelope: the amplitude of a ring-down"""
    unit: Annotated[str, Field(min_length=1, max_length=16)] = "V"
    """unit to read for V in this table, if the sensor has its own: px, µstrain, mm, mm/s, g; the same as in the
    record"""
    noise_V: Positive = Field(examples=[1e-4])
    """rms noise of one sample, quantisation included"""
    offset_sd_V: NotNegative = 0.0
    """how far from zero the offset may be (one standard deviation)"""
    interface: Interface = Interface()
    """table [device.sense.interface]"""

    @model_validator(mode="after")
    def _level_is_known(self) -> Self:
        if self.is_envelope and self.unit not in LEVELS and self.unit.lower().startswith(_LOGARITHMIC):
            raise ValueError(
                f"unit: {self.unit!r} is no level that is known; there are {', '.join(LEVELS)}; convert the record, or "
                "give the unit of an amplitude, as V or mm"
            )
        return self

    @property
    def order(self) -> int:
        """How often the displacement is differentiated to give what the channel shows."""
        return {"velocity": 1, "acceleration": 2}.get(self.senses, 0)

    @property
    def is_envelope(self) -> bool:
        """Whether the amplitude is shown, and no waveform."""
        return self.senses == "envelope"

    @property
    def is_in_decibels(self) -> bool:
        """Whether that is a logarithm."""
        return self.is_envelope and self.unit in LEVELS

    @model_validator(mode="after")
    def _levels_are_of_amplitudes(self) -> Self:
        if self.unit in LEVELS and not self.is_envelope:
            raise ValueError(
                f'unit: "{self.unit}" is a level, and a level is of an amplitude; set senses = "envelope", '
                "or give the waveform in its own unit"
            )
        return self


class Drive(Section):
    """The drive chain: what a drive value means and how it acts between two samples."""

    unit: DriveUnit = "mps2"
    """unit of the drive channel: force per mass, force, or a voltage; a board always uses m/s², and full_scale is
    converted to that"""
    full_scale: Positive = Field(examples=[10.0])
    """largest drive magnitude, in `unit`"""
    gain_N_per_V: float | None = None
    """force per volt of drive, for unit = "V"; the initial value where gain_known = false"""
    gain_known: bool = True
    """false: the drive gain is estimated as well (axes = 1)"""
    hold: Literal["zoh", "foh", "bandlimited"] = "zoh"
    """zoh: a row's value acted over the interval that ends there; foh, bandlimited: value at that instant"""
    noise_mps2_per_rtHz: NotNegative = 0.0
    """one-sided noise density of the drive amplifier"""

    @model_validator(mode="after")
    def _gain_matches_unit(self) -> Self:
        if (self.unit == "V") != (self.gain_N_per_V is not None):
            remedy = "give the force per volt" if self.unit == "V" else 'leave it out, or set unit = "V"'
            raise ValueError(f'gain_N_per_V: belongs to unit = "V" and only there; {remedy}')
        if self.gain_N_per_V == 0:
            raise ValueError("gain_N_per_V: 0 would mean that the drive does nothing")
        return self


class Device(Section):
    """The oscillator as its data sheet describes it, which is also the observer's initial value."""

    name: str = Field(examples=["G-5k"])
    """what the device is called in reports"""
    axes: Literal[1, 2] = 2
    """2: gyro (x and y); 1: single oscillator"""
    mass_kg: Positive = Field(examples=[1e-8])
    """proof mass"""
    stiffness_N_per_m: Numbers = Field(examples=[(9.87, 9.86, 0.0)])
    """[kxx, kyy, kxy] for two axes, [k] for one, [0] for one mass on no spring; or resonance_Hz"""
    damping_N_s_per_m: Numbers = Field(examples=[(3.1e-8, 3.1e-8, 0.0)])
    """[dxx, dyy, dxy] for two axes, [d] for one; or q, or decay_time_s"""
    amplitude_m: Positive = Field(examples=[1e-6])
    """nominal amplitude of the vibration"""
    sample_rate_Hz: Positive = Field(examples=[100000.0])
    """rate of the sense samples; must be the board's"""
    normalised: bool = True
    """report parameters per unit mass (1/s², 1/s); false: in N/m and N·s/m"""
    sense: Sense
    """table [device.sense]"""
    drive: Drive
    """table [device.drive]"""
    calibration: Calibration = Calibration()
    """table [device.calibration]"""

    @classmethod
    def other_keys(cls) -> dict[str, str]:
        """Keys that the table takes beside its fields, each with the field that it stands for."""
        modes = {name: key for key, names in STANDS_FOR.items() for name in names}
        return super().other_keys() | modes

    @model_validator(mode="before")
    @classmethod
    def _in_stiffness_and_damping(cls, table: Any) -> Any:
        return in_stiffness_and_damping(table) if isinstance(table, Mapping) else table

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        schema = super().__get_pydantic_json_schema__(core, handler)
        table = handler.resolve_ref_schema(schema)
        modes = Modes.model_json_schema()["properties"]
        for key, names in STANDS_FOR.items():
            offered = {name: modes[name] for name in names}
            offer_instead(table, key, {name: offered.pop(name) for name in names if name not in STANDS_BESIDE})
            table["properties"] |= offered
        table["dependentRequired"] = {"split_Hz": ["resonance_Hz"], "azimuth_deg": ["split_Hz"]}
        return schema

    @model_validator(mode="after")
    def _axes_agree(self) -> Self:
        check_matrix("stiffness_N_per_m", "k", self.stiffness_N_per_m, self.axes)
        check_matrix("damping_N_s_per_m", "d", self.damping_N_s_per_m, self.axes)
        if len(self.sense.gain_V_per_m) not in (1, self.axes) or 0 in self.sense.gain_V_per_m:
            raise ValueError(f"[device.sense] gain_V_per_m: expected one number or {self.axes}, none of them 0")
        if self.axes != 1 and self.sense.senses not in ("displacement", "velocity"):
            raise ValueError(
                f'[device.sense] senses: "{self.sense.senses}" is for axes = 1; trace the axes one by one, or integrate'
            )
        lowest = min(self.stiffness_N_per_m[: self.axes])
        if self.axes == 2 and lowest <= 0:
            raise ValueError("stiffness_N_per_m: the diagonal must be positive, or nothing oscillates")
        if lowest < 0:
            raise ValueError("stiffness_N_per_m: must not be negative; 0 is a mass on no spring")
        for key in ("stiffness_N_per_m", "damping_N_s_per_m") if self.axes == 2 else ():
            xx, yy, xy = getattr(self, key)
            if min(xx, yy) < 0 or xy * xy > xx * yy:
                told = "xx and yy must not be negative, and xy² at most xx·yy"
                raise ValueError(f"{key}: a matrix [xx, yy, xy] that could add energy; {told}")
        if not self.drive.gain_known and self.axes != 1:
            raise ValueError("[device.drive] gain_known: a drive gain is estimated for axes = 1 only; set it to true")
        if self.sense.is_envelope and min(self.sense.gain_V_per_m) < 0:
            raise ValueError("[device.sense] gain_V_per_m: negative, but an amplitude has no sign; leave it out")
        if wrong := self.sense.interface.wrong(self.axes, self.amplitude_m, self.sense.senses):
            raise ValueError(f"[device.sense.interface] {wrong}")
        if not self.sense.is_envelope and self.sample_rate_Hz < 4 * self.resonance_Hz:
            raise ValueError(
                f"sample_rate_Hz: {self.sample_rate_Hz:g} gives fewer than 4 samples per cycle "
                f"of {self.resonance_Hz:.4g} Hz"
            )
        return self

    @property
    def resonance_Hz(self) -> float:
        """The higher of the axes' declared resonances."""
        return math.sqrt(max(self.stiffness_N_per_m[: self.axes]) / self.mass_kg) / (2 * math.pi)

    @property
    def resonance_rad_s(self) -> float:
        """The same in rad/s."""
        return 2 * math.pi * self.resonance_Hz

    @property
    def known(self) -> dict[str, Known]:
        """Standard uncertainty of each constant behind the angle, by name, the sense interface's with them."""
        resonance = self.resonance_rad_s
        return self.calibration.known(resonance, self.sense.interface.uncertain(self.axes, resonance, self.amplitude_m))

    @property
    def stiffness_per_s2(self) -> tuple[float, ...]:
        """Declared stiffness per unit mass, 1/s², in the order of the file."""
        return tuple(k / self.mass_kg for k in self.stiffness_N_per_m)

    @property
    def damping_per_s(self) -> tuple[float, ...]:
        """Declared damping per unit mass, 1/s, in the order of the file."""
        return tuple(d / self.mass_kg for d in self.damping_N_s_per_m)

    @property
    def sense_gains_V_per_m(self) -> tuple[float, ...]:
        """One sense gain per axis."""
        gains = self.sense.gain_V_per_m
        return gains if len(gains) == self.axes else gains * self.axes

    def drive_mps2_per(self, unit: DriveUnit) -> Fraction | None:
        """Force per mass for a drive value of one `unit`; None for a volt whose force the bench file does not tell.

        Every conversion of a drive goes through here. It is exact, so that no limit is rounded up on its way to a code.
        """
        if unit == "mps2":
            return Fraction(1)
        newton = Fraction(1) if unit == "N" else self.drive.gain_N_per_V
        return None if newton is None else Fraction(newton) / Fraction(self.mass_kg)

    @property
    def drive_full_scale_mps2(self) -> Fraction:
        """Largest drive as a force per mass."""
        scale = self.drive_mps2_per(self.drive.unit)
        assert scale is not None
        return abs(scale) * Fraction(self.drive.full_scale)
