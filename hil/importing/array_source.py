"""Arrays given by a program as a source of columns."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.importing.mapping import Name
from hil.importing.source import Selection, Table, Values, Wanted, kept_rows, numbers, position


class ArraySource:
    """Arrays (n,) by name."""

    kind = "arrays"

    def __init__(self, columns: Mapping[str, npt.ArrayLike], called: str) -> None:
        self.called = called
        self._columns = columns

    @property
    def names(self) -> Sequence[str]:
        """As given."""
        return list(self._columns)

    def locate(self, name: Name) -> int:
        """The position of a column from 0."""
        return position(name, self.names, self.called)

    def read(self, wanted: Sequence[Wanted], selection: Selection) -> Table:
        """Those columns; a row's number counts from 0."""
        names = self.names
        times = {one.at for one in wanted if one.is_time}
        given = {one.at: _array(names[one.at], self._columns[names[one.at]], one.is_time) for one in wanted}
        base = names[min(times)] if times else names[wanted[0].at]
        count = given[names.index(base)].size
        for index, array in given.items():
            if array.size != count:
                raise InputError(f"{names[index]}: {array.size} values where {base} has {count}; give one of each row")
        where = {index: np.asarray(self._columns[names[index]]) for index in selection.where}
        for index, array in where.items():
            if array.shape != (count,):
                raise InputError(f"{names[index]}: an array of shape {array.shape}; give one of shape ({count},)")
        rows = kept_rows(self, where, count, selection) if count else np.zeros(0, np.int64)
        columns: list[Values] = []
        for one in wanted:
            values = given[one.at][rows]
            columns.append(values if one.is_time else numbers(self, values, rows, names[one.at], selection.missing))
        return Table(columns, rows, count)

    def place(self, row: int, column: str) -> str:
        """Array and index."""
        return f"{column}[{row}]"

    def advice(self, ordinary: str) -> str:
        """Arrays have no structure to be found out."""
        return ordinary


def _array(name: str, given: npt.ArrayLike, is_time: bool) -> Values:
    if np.ma.is_masked(given):
        row = int(np.argmax(np.ma.getmaskarray(np.ma.asarray(given))))
        raise InputError(f"{name}[{row}]: masked, which is no measurement; leave the row out")
    try:
        array = np.asarray(given)
    except (TypeError, ValueError):
        raise InputError(f"{name}: no array of numbers") from None
    if is_time and array.dtype.kind in "UT":
        array = array.astype(object)
    if array.dtype.kind not in ("fiumMO" if is_time else "fiu"):
        raise InputError(f"{name}: no array of numbers, but of {_kind(array)}; give real numbers")
    if array.ndim != 1:
        raise InputError(f"{name}: an array of shape {array.shape}; give one of shape (n,)")
    return array


def _kind(array: npt.NDArray[Any]) -> str:
    """What an array holds, for an error."""
    if array.dtype.kind == "O":
        return type(array.flat[0]).__name__ if array.size else "nothing"
    return "text" if array.dtype.kind in "USaT" else str(array.dtype)
