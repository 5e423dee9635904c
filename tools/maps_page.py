"""Tables of the reference page of maps."""

from hil.importing.channels import dimension_of
from hil.importing.mapping import Addend, Columns, Filter, RecordMap, Source, Time
from hil.importing.units import MOTIONS, NAMES, UNITS, VOLTS_OF_LEVELS
from hil.records.capture import DRIVE_UNITS
from tools.markdown import keys_table, table

_CHANNELS = {
    "t_s": "time",
    "vx_V": "what the sensor of x shows, in volts",
    "vy_V": "the same of y",
    "vx": "what the sensor of x shows, in a unit of its own: any word of up to 16 letters, kept as it is",
    "vy": "the same of y",
    "base": "motion of the base of a single axis, which is its drive",
    "ux_mps2": "drive of x, force per unit mass",
    "ux_N": "drive of x, force",
    "ux_V": "drive of x, voltage",
    "uy_mps2": "drive of y, force per unit mass",
    "uy_N": "drive of y, force",
    "uy_V": "drive of y, voltage",
    "rate_rad_s": "reference for the rate",
    "temp_C": "temperature",
    **{
        f"{what}{axis}_{part}_{unit}": f"{named} of {axis}, demodulated, {'in phase' if part == 'i' else 'quadrature'}"
        for what, named, units in (("v", "what is sensed", ("V",)), ("u", "drive", DRIVE_UNITS))
        for axis in "xy" for part in "iq" for unit in units
    },
    "carrier_Hz": "carrier of demodulated streams",
}  # fmt: skip


def channels() -> str:
    """The channels of a record, with their units."""
    rows = ((f"`{name}`", _CHANNELS[name], _units_of(name)) for name in Columns.model_fields)
    return table(("channel", "is", "unit"), rows)


def motions() -> str:
    """Units of a base, by what is given in them."""
    rows = []
    for order, what in enumerate(NAMES):
        units = ", ".join(f"`{unit}`" for unit, motion in MOTIONS.items() if motion.order == order)
        rows.append((units, what))
    return table(("unit", "base and `frame` take it as"), rows)


def _units_of(channel: str) -> str:
    if channel in ("vx", "vy"):
        return "any"
    if channel in ("vx_V", "vy_V"):
        return ", ".join(f"`{unit}`" for unit in (*UNITS["V"], *VOLTS_OF_LEVELS))
    if channel == "base":
        return "see below"
    return ", ".join(f"`{unit}`" for unit in UNITS[dimension_of(channel)])


PARTS = {
    "keys": lambda: keys_table(RecordMap, skip=("columns", "segments", "filter")),
    "channels": channels,
    "column": lambda: keys_table(Source),
    "time": lambda: keys_table(Time, skip=tuple(Source.model_fields)),
    "addend": lambda: keys_table(Addend),
    "motions": motions,
    "filter": lambda: keys_table(Filter),
}
