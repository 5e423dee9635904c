"""Units that a map may name, and what leads from each to SI; what a sensor's own unit says of what it senses."""

from typing import NamedTuple

from hil.records.units import LEVELS
from hil.toml.reading import suggestion

_TURN_RAD = 6.283185307179586
_G = 9.80665

_DEGREE = _TURN_RAD / 360
_FACTORS = {
    "s": {
        "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "day": 86400.0,
        "week": 604800.0, "iso": 1.0,  # ISO 8601 text, or a type of dates or lengths of time, which has its own unit
    },
    "V": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "µV": 1e-6},
    "N": {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "µN": 1e-6},
    "mps2": {"m/s^2": 1.0, "m/s²": 1.0, "mps2": 1.0, "g": _G},
    "rad_s": {
        "rad/s": 1.0, "mrad/s": 1e-3, "deg/s": _DEGREE, "°/s": _DEGREE, "dps": _DEGREE, "mdps": 1e-3 * _DEGREE,
        "deg/h": _DEGREE / 3600, "rpm": _TURN_RAD / 60,
    },
    "Hz": {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6},
}  # fmt: skip
# unit → (factor, addition) that lead to the channel's SI unit
UNITS: dict[str, dict[str, tuple[float, float]]] = {
    of: {unit: (factor, 0.0) for unit, factor in units.items()} for of, units in _FACTORS.items()
} | {"C": {"degC": (1.0, 0.0), "°C": (1.0, 0.0), "K": (1.0, -273.15)}}
UNITS["amplitude_V"] = UNITS["V"] | {  # an instrument may tell a component's rms
    f"{unit}rms": (2**0.5 * factor, 0.0) for unit, (factor, _) in UNITS["V"].items()
}


class Motion(NamedTuple):
    """How often a displacement is differentiated to give what is in this unit, and SI for one of it."""

    order: int
    factor: float


MOTIONS = {
    unit: Motion(order, factor)
    for order, units in enumerate((
        {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9},
        {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "µm/s": 1e-6},
        {"m/s^2": 1.0, "m/s²": 1.0, "mps2": 1.0, "g": _G, "mg": 1e-3 * _G},
    ))
    for unit, factor in units.items()
}  # fmt: skip
"""Units of displacement, velocity and acceleration."""

VOLTS_OF_LEVELS = {"dBV": 1.0, "dBmV": 1e-3, "dBuV": 1e-6, "dBµV": 1e-6}
"""What 0 dB is, in volts: levels that become amplitudes in vx_V and vy_V."""
_CODES = ("LSB", "lsb", "counts", "count", "digits", "codes")
NAMES = ("displacement", "velocity", "acceleration")
LONGEST = 16


def one_spelling(unit: str) -> str:
    """A unit whose µ is the micro sign, which the Greek letter looks like."""
    return unit.replace("\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}")


def factor_and_addition(dimension: str, unit: str) -> tuple[float, float]:
    """What leads to SI from a unit of that dimension. Raises ValueError with the nearest known unit."""
    known = UNITS[dimension]
    if unit in _CODES:
        raise ValueError(
            f"unit: {unit!r} says nothing by itself; give scale = what one is, and its unit: {', '.join(known)}"
        )
    if unit not in known:
        raise ValueError(f"unit: {unit!r} is not known; {suggestion(unit, list(known))}")
    return known[unit]


def motion_of(unit: str) -> Motion:
    """What a base that moves is given in. Raises ValueError for anything else."""
    if unit not in MOTIONS:
        raise ValueError(f"unit: {unit!r} is no unit of a motion; {suggestion(unit, list(MOTIONS))}")
    return MOTIONS[unit]


def require_own_unit(unit: str) -> None:
    """A sensor's own unit is a short word. Raises ValueError for what is none."""
    if unit[:2].lower() == "db" and unit not in LEVELS and unit.lower() != "dbar":
        raise ValueError(f"unit: {unit!r} is no level that is known; {suggestion(unit, LEVELS)}")
    if not unit or len(unit) > LONGEST or not unit.isprintable() or unit != unit.strip():
        raise ValueError(
            f"unit: {unit!r} is no unit; give a word of at most {LONGEST} letters, as px, µstrain, mm or g"
        )
