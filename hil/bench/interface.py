"""The sense interface by name, [device.sense.interface]: what turns the motion into the voltage of a channel."""

import math
from typing import Self

from pydantic import model_validator

from estimator.interface import MAPS, Kind
from estimator.interface import Interface as Map
from hil.bench.calibration import Relative, Sensed
from hil.bench.section import NotNegative, Numbers, Section

KEYS = {
    "gap_closing": "gap_m",
    "optical": "distortion_per_m2",
    "piezoresistive": "temperature_per_K",
    "piezoelectric": "corner_Hz",
    "tunnelling": "decay_per_m",
}
"""The key that holds the constant of each map."""
_U, _U_K = 0.02, 5.0  # of a drawn gap or a data sheet's typical value; of a room, and of the part's own heat
_DEEPEST = 3.0  # decay lengths within the amplitude: a current over e³ of that at rest leaves the amplifier's range

assert set(KEYS) == set(MAPS)


class Interface(Section):
    """The sense interface: the map from motion to voltage. `gain_V_per_m` is the gain at rest, `noise_V` the noise at
    rest."""

    kind: Kind = "comb"
    """comb: V = g·x; gap_closing: g·x/(1 - (x/gap)²); optical: g·x·(1 + distortion·r²), V may be px; piezoresistive:
    g·x·(1 + temperature·(T - first reading)); piezoelectric: g·velocity behind a first-order corner, with senses =
    "velocity"; tunnelling: g·(exp(decay·x) - 1)/decay, its noise grows with √exp(decay·x)"""
    gap_m: Numbers | None = None
    """gap_closing: gap at rest; one number, or one per axis, as the keys below"""
    distortion_per_m2: Numbers | None = None
    """optical: radial distortion of the lens, of the displacement"""
    temperature_per_K: Numbers | None = None
    """piezoresistive: change of the gain per kelvin, relative"""
    corner_Hz: Numbers | None = None
    """piezoelectric: 1/(2π Rf Cf) of the current amplifier"""
    decay_per_m: Numbers | None = None
    """tunnelling: decay of the current over the distance, positive where it grows with the displacement"""
    constant_u: Relative | None = None
    """standard uncertainty of that constant, relative; without it 0.02 is assumed"""
    temperature_u_K: NotNegative | None = None
    """piezoresistive: standard uncertainty of the gauges' temperature, beside the one recorded or the first reading;
    without it 5 is assumed"""

    @property
    def key(self) -> str | None:
        """The key of its constant."""
        return KEYS.get(self.kind)

    @model_validator(mode="after")
    def _keys_are_of_the_kind(self) -> Self:
        for kind, key in KEYS.items():
            if (getattr(self, key) is not None) == (kind == self.kind):
                continue
            if kind == self.kind:
                raise ValueError(f'{key}: missing; kind = "{kind}" needs it')
            raise ValueError(f'{key}: belongs to kind = "{kind}", not "{self.kind}"; leave it out')
        if self.kind == "comb" and self.constant_u is not None:
            raise ValueError('constant_u: kind = "comb" has no constant; leave it out')
        if self.kind != "piezoresistive" and self.temperature_u_K is not None:
            raise ValueError('temperature_u_K: belongs to kind = "piezoresistive"; leave it out')
        return self

    def map(self, axes: int, omega0: float) -> Map:
        """The map of a device with that many axes and that target frequency [rad/s]."""
        given = () if self.key is None else getattr(self, self.key)
        constants = tuple(map(float, given if len(given) in (0, axes) else given * axes))
        if self.kind == "piezoelectric":
            constants = tuple(math.tau * corner for corner in constants)
        return Map(self.kind, constants, omega0)

    def uncertain(self, axes: int, omega0: float, amplitude_m: float) -> Sensed | None:
        """What is uncertain of the map, on a device with that target frequency [rad/s]; None of a comb."""
        if self.kind == "comb":
            return None
        relative = _U if self.constant_u is None else self.constant_u
        u_K = _U_K if self.temperature_u_K is None else self.temperature_u_K
        one = self.map(axes, omega0)
        return Sensed(
            one.amplitude_error(amplitude_m, relative, u_K),
            one.delay_error_s(relative),
            self.constant_u is None or (self.kind == "piezoresistive" and self.temperature_u_K is None),
        )

    def wrong(self, axes: int, amplitude_m: float, senses: str) -> str | None:
        """The first thing that does not fit the device, as `key: what; remedy`."""
        if (self.kind == "piezoelectric") != (senses == "velocity") and self.kind != "comb":
            needed = "velocity" if self.kind == "piezoelectric" else "displacement"
            return f'kind: "{self.kind}" senses a {needed}; set [device.sense] senses = "{needed}"'
        if self.kind not in ("comb", "piezoelectric") and senses != "displacement":
            return f'kind: "{self.kind}" senses a displacement; set [device.sense] senses = "displacement"'
        if self.key is None:
            return None
        given = getattr(self, self.key)
        if len(given) not in (1, axes):
            return f"{self.key}: expected one number or {axes}, one per axis, not {len(given)}"
        if self.kind in ("gap_closing", "piezoelectric") and min(given) <= 0.0:
            return f"{self.key}: must be above 0"
        if self.kind == "gap_closing" and min(given) <= amplitude_m:
            return f"gap_m: {min(given):g} m is within the amplitude of {amplitude_m:g} m; a plate would be touched"
        if self.kind == "optical" and 3.0 * min(given) * amplitude_m**2 <= -1.0:
            return f"distortion_per_m2: {min(given):g} folds the image within the amplitude of {amplitude_m:g} m"
        if self.kind == "tunnelling" and max(map(abs, given)) * amplitude_m > _DEEPEST:
            return f"decay_per_m: the current would change by more than e³ within {amplitude_m:g} m; the unit is 1/m"
        return None
