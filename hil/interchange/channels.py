"""The channels an interchange file may have, their order, and the rules a set of them must keep."""

import difflib
from collections.abc import Sequence

from hil.records.capture import DRIVE_UNITS

_X_DRIVES = tuple(f"ux_{unit}" for unit in DRIVE_UNITS)
_Y_DRIVES = tuple(f"uy_{unit}" for unit in DRIVE_UNITS)

CHANNELS = ("t_s", "vx_V", "vy_V", *_X_DRIVES, *_Y_DRIVES, "rate_rad_s", "temp_C")
"""Every legal column name, in the order in which files are written."""


def fault_in(names: Sequence[str], *, needs_time: bool) -> str | None:
    """What is wrong with this set of channels, with the cure; None when it can be a record."""
    for name in names:
        if name not in CHANNELS:
            near = difflib.get_close_matches(name, CHANNELS, n=1)
            cure = f"did you mean {near[0]}?" if near else f"known are {', '.join(CHANNELS)}, others need --map"
            return f"column {name!r} is not known; {cure}"
        if names.count(name) > 1:
            return f"column {name!r} appears twice; keep one"
    if needs_time and "t_s" not in names:
        return "no column t_s; add it, or state sampling_rate_Hz in a --map file"
    if "vx_V" not in names:
        return "no column vx_V; a record needs at least one sensed voltage"
    x_drives = [name for name in names if name in _X_DRIVES]
    y_drives = [name for name in names if name in _Y_DRIVES]
    if len(x_drives) > 1 or len(y_drives) > 1:
        return f"two drives of one axis ({', '.join(x_drives + y_drives)}); keep the one in the drive's own unit"
    if "vy_V" not in names and y_drives:
        return f"column {y_drives[0]} without vy_V; add vy_V, or leave y out for a single-axis device"
    if "vy_V" in names and [name[2:] for name in x_drives] != [name[2:] for name in y_drives]:
        given = ", ".join(x_drives + y_drives)
        return f"two axes but the drives are {given}; give ux and uy in one unit, or neither"
    return None
