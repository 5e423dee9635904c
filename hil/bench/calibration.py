"""How well the constants are known that turn codes into motion and motion into an angle: [device.calibration].

Each is a standard uncertainty after JCGM 100 (GUM). What the bench file does not declare is assumed: what a data sheet
of such a part usually promises, taken as a uniform distribution where it gives limits (limit / √3), and marked as
assumed wherever it is used.
"""

import math
from typing import Annotated, NamedTuple

from pydantic import Field

from hil.bench.section import NotNegative, Positive, Section

Relative = Annotated[float, Field(ge=0, lt=1)]


class Sensed(NamedTuple):
    """What is uncertain of a sense interface's map: the amplitude that it reads, relative; how late it is, in addition
    to what else delays the channel; and whether either was assumed."""

    amplitude_u: float
    delay_u_s: float
    assumed: bool


class Calibration(Section):
    """Standard uncertainties (k = 1) of constants that a record alone does not determine. Each becomes a row of the
    angle's uncertainty budget. If a key is not given, a usual value is assumed and the row is marked as assumed."""

    angular_gain: Positive = 1.0
    """angle by which the pattern rotates for each radian of the board's rotation; 1 for a rigid mass"""
    angular_gain_u: Relative | None = None
    """of the angular gain, relative; without it 0.001 is assumed"""
    clock_u: Relative | None = None
    """of the board's sample rate, relative; without it 3e-5 is assumed"""
    drive_gain_u: Relative | None = None
    """of the product of force per drive code and volts per metre, for each axis independently, relative; without it
    0.01 is assumed"""
    drive_misalignment_u: Relative | None = None
    """share of each axis' drive that pushes the other axis; without it 0.002 is assumed"""
    drive_delay_u_s: NotNegative | None = None
    """delay of each axis' drive in addition to what the board states; without it 1 mrad of the resonance is assumed"""
    sense_gain_ratio_u: Relative | None = None
    """of the ratio of the sense gain of y to that of x, relative; without it 0.005 is assumed"""
    sense_cross_coupling_u: Relative | None = None
    """share of each axis' motion that the other channel senses; without it 0.002 is assumed"""
    sense_delay_u_s: NotNegative | None = None
    """delay of each sense channel in addition to what the board states; without it 1 mrad of the resonance is
    assumed"""
    angle_map: str | None = None
    """file of what depends on the pattern's angle, `calibrations/SERIAL.toml` of `hil characterise --calibrate`: it is
    taken off angle and rate; a path, also from the bench file's folder"""

    def known(self, resonance_rad_s: float, sensed: Sensed | None = None) -> dict[str, "Known"]:
        """Standard uncertainty of each constant by name, for a device with this resonance and, where it is no
        comb, this interface.
        """
        found = {}
        for name, (value, unit, _) in ASSUMED.items():
            per_s = unit == "s"
            declared = getattr(self, f"{name}_u{'_s' if per_s else ''}")
            assumed = value / resonance_rad_s if per_s else value
            found[name] = Known(assumed if declared is None else declared, unit, declared is None)
        if sensed is not None:
            found["sense_interface"] = Known(sensed.amplitude_u, "1", sensed.assumed)
            late = found["sense_delay"]
            found["sense_delay"] = late._replace(u=math.hypot(late.u, sensed.delay_u_s))
        return found

    def by_symbol(self, resonance_rad_s: float) -> dict[str, float]:
        """Standard uncertainty, SI, of each constant that a scan watches, by symbol of its coefficients."""
        known = self.known(resonance_rad_s)
        return {symbol: known[name].u for name, symbols in SYMBOLS.items() for symbol in symbols}


class Known(NamedTuple):
    """A standard uncertainty in its unit ("1": relative), and whether it was assumed rather than declared."""

    u: float
    unit: str
    assumed: bool


class Assumed(NamedTuple):
    """What is taken where a bench file says nothing; for "s" in radians of the resonance. `why` names a reason."""

    value: float
    unit: str
    why: str


ASSUMED = {
    "angular_gain": Assumed(
        1e-3,
        "1",
        "a rigid mass has the angular gain 1, by geometry; springs and frame take part in the motion by a few "
        "thousandths (Lynch, IEEE Std 1431 annex B; Shkel, IEEE PLANS 2006)",
    ),
    "clock": Assumed(3e-5, "1", "a crystal oscillator within ± 50 ppm over temperature and age"),
    "drive_gain": Assumed(
        0.01,
        "1",
        "a trimmed scale factor within ± 2 %, as data sheets of MEMS gyroscopes guarantee for the sensitivity",
    ),
    "drive_misalignment": Assumed(2e-3, "1", "two layers of one die within half a micrometre over 150 µm"),
    "drive_delay": Assumed(1e-3, "s", "an amplifier with its pole at ten times the resonance, known to 1 %"),
    "sense_gain_ratio": Assumed(5e-3, "1", "two capacitors of one die matched within ± 1 %"),
    "sense_cross_coupling": Assumed(2e-3, "1", "as the drive's misalignment"),
    "sense_delay": Assumed(1e-3, "s", "as the drive's delay"),
}
"""Standard uncertainties where the bench file gives none, with reasons; explained in docs/explanation.md."""

SYMBOLS = {
    "drive_gain": ("hx", "hy"),
    "sense_gain_ratio": ("gy",),
    "drive_misalignment": ("mx", "my"),
    "sense_cross_coupling": ("ex", "ey"),
    "drive_delay": ("tux", "tuy"),
    "sense_delay": ("tsx", "tsy"),
    "clock": ("clock",),
}
"""Constants that a scan watches, by the symbols of their coefficients in the catalogue, which has no clock."""
