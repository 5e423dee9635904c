"""Records as columns with units."""

from typing import Any

import numpy.typing as npt

from hil.errors import InputError
from hil.library.series import Series
from hil.records.capture import Capture
from hil.records.estimates import Estimates
from hil.records.innovation import Innovation
from hil.records.units import unit_of

ANGLE = ("angle_rad", "angle_u_rad", "valid")
RATE = ("rate_rad_s", "sd_rate_rad_s")


def of_capture(capture: Capture, run: str) -> Series:
    """What was sensed and driven, and reference rate and temperature if any."""
    from hil.exporting.exported import channels

    columns = channels(capture)
    units = {name: capture.sense_unit if name.endswith("_sensed") else unit_of(name) for name in columns}
    carrier = {} if capture.carrier_Hz is None else {"demodulated": str(capture.carrier_Hz)}
    return Series(columns.pop("t_s"), columns, units, {"run": run, "hold": capture.hold, **carrier})


def of_estimates(estimates: Estimates, run: str) -> Series:
    """States, standard deviations, and of two axes the angle with all that belongs to it."""
    columns = {name: values for name, values in estimates.columns.items() if name != "tick"}
    if "valid" in columns:
        columns["valid"] = estimates.valid  # true or false, as the file has it in bytes, which would be places of rows
    return Series(estimates.t_s, columns, {name: estimates.unit(name) for name in columns}, {"run": run})


def of_innovation(innovation: Innovation, run: str) -> Series:
    """Measured minus predicted voltage, and its predicted deviation."""
    columns: dict[str, npt.NDArray[Any]] = {n: v for n, v in innovation.columns.items() if n != "tick"}
    return Series(innovation.t_s, columns, dict.fromkeys(columns, innovation.unit), {"run": run})


def chosen(every: Series, names: tuple[str, ...]) -> Series:
    """Those columns of estimates that are there.  Raises InputError where the first is not."""
    if names[0] not in every:
        raise InputError(f"{every.header.get('run')}: its model has no {names[0]}; it has {', '.join(every)}")
    there = [name for name in names if name in every]
    return Series(every.t_s, {n: every[n] for n in there}, {n: every.units[n] for n in there}, every.header)
