"""The channels an interchange file may have, their order, and the rules a set of them must keep."""

import difflib
from collections.abc import Sequence

from hil.records.capture import DRIVE_UNITS

_X_DRIVES = tuple(f"ux_{unit}" for unit in DRIVE_UNITS)
_Y_DRIVES = tuple(f"uy_{unit}" for unit in DRIVE_UNITS)

OWN = ("vx", "vy")
"""Sense channels in the sensor's own unit; of a map only, which says the unit."""
SENSED = {"vx": "vx_sensed", "vy": "vy_sensed"}
"""What those are called in a capture."""

DRIVEN = tuple(f"u{axis}_{part}_{unit}" for unit in DRIVE_UNITS for axis in "xy" for part in "iq")
COMPONENTS = (*(f"v{axis}_{part}_V" for axis in "xy" for part in "iq"), *DRIVEN)
"""Of demodulated streams."""

CHANNELS = ("t_s", "vx_V", "vy_V", *_X_DRIVES, *_Y_DRIVES, "rate_rad_s", "temp_C")
"""Every legal column name, in the order in which files are written."""
_OF_MAPS = (*CHANNELS, *OWN, "base")


def names_fault(
    names: Sequence[str], known: Sequence[str], told: Sequence[str], *, needs_time: bool, beside: str = ""
) -> str | None:
    """What is wrong with the names, each by itself, and with the time; `told`: of those that are known."""
    for name in names:
        if name not in known:
            near = near_channel(name, known)
            remedy = f"did you mean {near}?" if near else f"known are {', '.join(told)}, others need --map"
            return f"column {name!r} is not known{beside}; {remedy}"
        if names.count(name) > 1:
            return f"column {name!r} appears twice; keep one"
    if needs_time and "t_s" not in names:
        return "no column t_s; add it, or state sampling_rate_Hz in a --map file"
    return None


def fault_in(names: Sequence[str], *, needs_time: bool, mapped: bool = False) -> str | None:
    """What is wrong with this set of channels, of a file or of a map, with the remedy; None when it can be a record."""
    for name in names:
        if name in COMPONENTS:
            return f"column {name!r} is a component of a demodulated stream; give its carrier, --demodulated HZ"
    known = _OF_MAPS if mapped else CHANNELS
    if fault := names_fault(names, known, CHANNELS, needs_time=needs_time):
        return fault
    x_senses = [name for name in names if name in ("vx_V", "vx")]
    y_senses = [name for name in names if name in ("vy_V", "vy")]
    if not x_senses:
        return "no column vx_V; a record needs at least one sensed voltage" + (
            ", or vx in the sensor's own unit" if mapped else ""
        )
    if len(x_senses) > 1 or len(y_senses) > 1:
        return "an axis both in volts and in a unit of its own; keep one of the two"
    if y_senses and y_senses[0][2:] != x_senses[0][2:]:
        return f"{x_senses[0]} and {y_senses[0]}; give both axes in volts, or both in the sensor's own unit"
    x_drives = [name for name in names if name in _X_DRIVES]
    y_drives = [name for name in names if name in _Y_DRIVES]
    if len(x_drives) > 1 or len(y_drives) > 1:
        return f"two drives of one axis ({', '.join(x_drives + y_drives)}); keep the one in the drive's own unit"
    if "base" in names and (x_drives or y_senses):
        other = "a drive" if x_drives else "two axes"
        return f"base beside {other}; a base moves one axis and is its only drive: leave one of them out"
    if not y_senses and y_drives:
        return f"column {y_drives[0]} without vy_V; add vy_V, or leave y out for a single-axis device"
    if y_senses and [name[2:] for name in x_drives] != [name[2:] for name in y_drives]:
        given = ", ".join(x_drives + y_drives)
        return f"two axes but the drives are {given}; give ux and uy in one unit, or neither"
    return None


def dimension_of(channel: str) -> str:
    """What its units are of: the end of its name."""
    if channel in COMPONENTS[:4]:
        return "amplitude_V"
    return channel.split("_", 2)[2] if channel in COMPONENTS else channel.split("_", 1)[1]


def near_channel(name: str, known: Sequence[str] = CHANNELS) -> str | None:
    """The channel that a name which is none may have been meant for."""
    by_small = {each.lower(): each for each in known}  # many instruments write names in capitals
    return next((by_small[each] for each in difflib.get_close_matches(name.lower(), by_small, n=1)), None)
