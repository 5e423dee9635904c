"""A record given as arrays becomes a capture, as one from a file does."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.interchange.channels import CHANNELS, fault_in
from hil.interchange.columns import write_columns
from hil.interchange.uniformity import first_not_increasing, numbered, odd_step, spacing
from hil.library.series import Series
from hil.records.capture import Hold, import_layout

CALLED = "the arrays given"


class Table(Protocol):
    """Columns by name: a Series, a frame of pandas, a table of pyarrow."""

    @property
    def columns(self) -> Any:
        """Their names, or in pyarrow themselves."""

    def __getitem__(self, name: Any, /) -> Any: ...


def columns_of(record: Any) -> dict[str, npt.ArrayLike] | None:
    """The arrays of a record by name: of a mapping, a Series, or a table of pandas or pyarrow, whose time may be the
    index; None where it is none of them.
    """
    if isinstance(record, Series):
        return {"t_s": record.t_s, **{name: record[name] for name in record}}
    if isinstance(record, Mapping):
        names = list(record)
    elif hasattr(record, "columns"):
        if getattr(getattr(record, "index", None), "name", None) == "t_s":
            record = record.reset_index()
        names = list(getattr(record, "column_names", record.columns))
    else:
        return None
    return {str(name): record[name] for name in names}


def write_capture(
    columns: Mapping[str, npt.ArrayLike], target: Path, *, hold: Hold = "zoh", nonuniform: bool = False
) -> None:
    """Write the capture of `columns`, (n,) each, by their names in an interchange CSV: t_s, vx_V, vy_V, ux_mps2 and
    uy_mps2 (or _V, _N), and optionally rate_rad_s and temp_C; a single axis leaves out y.

    Time may be datetime64 or timedelta64 too, and is even unless `nonuniform`.  Raises InputError that names the
    column.
    """
    if "t_s" not in columns:
        raise InputError(f"{CALLED}: no column t_s; add it, in seconds")
    if (fault := fault_in(list(columns), needs_time=True)) is not None:
        raise InputError(f"{CALLED}: {fault}")
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
    _, off = spacing(t_s)
    time = numbered(t_s)
    if off is not None and not nonuniform:
        remedy = f"{time.missing()}; give nonuniform=True to keep them as gaps" if time.lost else None
        raise InputError(
            f"t_s[{off}]: {odd_step(t_s, off)}; {remedy or 'give nonuniform=True if the record is meant so'}"
        )
    if time.mostly_lost:
        raise InputError(f"t_s: {time.missing()}, more than there are; give what lies before and behind by itself")
    layout = import_layout(names, tick_rate_Hz=time.rate_Hz, uniform=time.uniform, hold=hold, segments={})
    write_columns(target, layout, values, time.tick if time.lost else None)


def _numbers(name: str, given: npt.ArrayLike) -> npt.NDArray[np.float64]:
    if np.ma.is_masked(given):
        row = int(np.argmax(np.ma.getmaskarray(np.ma.asarray(given))))
        raise InputError(f"{name}[{row}]: masked, which is no measurement; leave the row out")
    try:
        array = np.asarray(given)
        if name == "t_s" and array.dtype.kind in "mM":
            array = _seconds(array)
    except (TypeError, ValueError):
        raise InputError(f"{name}: no array of numbers") from None
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name}: no array of numbers, but of {_kind(array)}; give real numbers")
    if array.ndim != 1:
        raise InputError(f"{name}: an array of shape {array.shape}; give one of shape (n,)")
    array = array.astype(float)
    if (bad := np.flatnonzero(~np.isfinite(array))).size:
        raise InputError(f"{name}[{bad[0]}]: {array[bad[0]]} is no measurement; leave the row out")
    return array


def _seconds(time: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Lengths of time in seconds; dates from the first one on, as a float has not the digits for all since 1970."""
    if time.dtype.kind == "M":
        time = time.astype("datetime64[ns]")
        time = time - time[:1]
    return time / np.timedelta64(1, "s")


def _kind(array: npt.NDArray[Any]) -> str:
    """What an array holds, for an error."""
    if array.dtype.kind == "O":
        return type(array.flat[0]).__name__
    return "text" if array.dtype.kind in "USaT" else str(array.dtype)
