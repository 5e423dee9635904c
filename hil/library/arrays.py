"""A record given as arrays becomes a capture, as one from a file does."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.interchange.channels import CHANNELS, fault_in
from hil.interchange.columns import write_columns
from hil.interchange.uniformity import first_not_increasing, spacing
from hil.records.capture import Hold, import_layout


def write_capture(columns: Mapping[str, npt.ArrayLike], target: Path, *, hold: Hold = "zoh") -> None:
    """Write the capture of `columns`, (n,) each, by their names in an interchange CSV: t_s, vx_V, vy_V, ux_mps2 and
    uy_mps2 (or _V, _N), and optionally rate_rad_s and temp_C; a single axis leaves out y.

    Time may be uneven.  Raises InputError that names the column.
    """
    if (fault := fault_in(list(columns), needs_time=True)) is not None:
        raise InputError(f"the arrays given: {fault}")
    names = [name for name in CHANNELS if name in columns]
    values = {name: _numbers(name, columns[name]) for name in names}
    t_s = values["t_s"]
    for name, array in values.items():
        if array.size != t_s.size:
            raise InputError(f"{name}: {array.size} values where t_s has {t_s.size}; give one of each row")
    if t_s.size < 2:
        raise InputError(f"t_s: {t_s.size} rows; a record needs at least two")
    if (row := first_not_increasing(t_s)) is not None:
        raise InputError(
            f"t_s[{row}]: {t_s[row]:.9g} s is not later than {t_s[row - 1]:.9g} s before it; sort the rows"
        )
    rate_Hz, off = spacing(t_s)
    layout = import_layout(names, tick_rate_Hz=rate_Hz, uniform=off is None, hold=hold, segments={})
    write_columns(target, layout, values)


def _numbers(name: str, given: npt.ArrayLike) -> npt.NDArray[np.float64]:
    try:
        array = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name}: no array of numbers") from None
    if array.ndim != 1:
        raise InputError(f"{name}: an array of shape {array.shape}; give one of shape (n,)")
    if (bad := np.flatnonzero(~np.isfinite(array))).size:
        raise InputError(f"{name}[{bad[0]}]: {array[bad[0]]} is no measurement; leave the row out")
    return array
