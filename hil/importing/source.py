"""What every kind of file, and arrays, are to an import: columns by position, of which some rows are read."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.importing.mapping import Name
from hil.toml.reading import near_or_all

Values = npt.NDArray[Any]


class Wanted(NamedTuple):
    """A column to read: its position from 0, what errors call it, whether it is a time (which may be text or dates),
    what stands between thousands in a text."""

    at: int
    called: str
    is_time: bool = False
    thousands: str | None = None


class Selection(NamedTuple):
    """The rows to keep: those in which columns (by position) read so, then [start, stop) of them, from 0; and the cells
    that are no measurement.
    """

    where: Mapping[int, str]
    rows: tuple[int, int] | None
    missing: Sequence[str | float]
    called: Mapping[int, str] = {}
    """What a map calls the columns of `where`."""


class Table(NamedTuple):
    """What was read: for each wanted column its values (n,), as numbers, dates or texts; NaN where a number is
    missing, as the selection says. rows: what places them in the file: a line of a text, else counted from 1.
    of: how many rows of the file were gone through.
    """

    columns: list[Values]
    rows: npt.NDArray[np.int64]
    of: int


class Source(Protocol):
    """An opened file, or arrays."""

    kind: str
    """What it is, in words: a text, a MATLAB file, a Parquet file, arrays."""
    called: str
    """What errors call it."""

    @property
    def names(self) -> Sequence[str]:
        """What its columns are called, in order."""

    def locate(self, name: Name) -> int:
        """The position of a column from 0. Raises InputError for one that is absent or not the only one."""

    def read(self, wanted: Sequence[Wanted], selection: Selection) -> Table:
        """Those columns. Raises InputError with the place of what is no number."""

    def place(self, row: int, column: str) -> str:
        """Where a row of a table's `rows` is, as an error begins: file, line or row, column."""

    def advice(self, ordinary: str) -> str:
        """The remedy for what does not fit: `ordinary`, or what the file's own structure asks for."""
        return ordinary


def position(name: Name, names: Sequence[str], called: str) -> int:
    """The position from 0 of the column called `name`, or the `name`-th. Raises InputError where that is not one."""
    if isinstance(name, int):
        if name > len(names):
            raise InputError(f"{called}: no column {name}; the file has {len(names)} columns")
        return name - 1
    if name not in names:
        raise InputError(f"{called}: no column {name!r}; {near_or_all(name, names)}")
    places = [index for index, other in enumerate(names, 1) if other == name]
    if len(places) > 1:
        among = ", ".join(map(str, places[:-1])) + f" and {places[-1]}"
        raise InputError(
            f"{called}: {len(places)} columns are called {name!r}, at positions {among}; "
            f"give the one that is meant by position, as column = {places[0]}"
        )
    return places[0] - 1


def kept_rows(source: Source, columns: Mapping[int, Values], count: int, selection: Selection) -> npt.NDArray[np.int64]:
    """The rows of typed columns that a selection keeps; columns: those of `where`, by position."""
    kept = np.ones(count, dtype=bool)
    for index, text in selection.where.items():
        kept &= _reads(columns[index], text)
    rows = np.flatnonzero(kept)
    start, stop = selection.rows or (0, None)
    rows = rows[start:stop]
    if not rows.size:
        raise InputError(f"{source.called}: no rows of numbers{among(selection)}; give a file that holds a record")
    return rows


def among(selection: Selection) -> str:
    told = "" if selection.rows is None else " in rows [{}, {})".format(*selection.rows)
    if selection.where:
        told += " where " + ", ".join(
            f"{selection.called[index]} reads {text!r}" for index, text in selection.where.items()
        )
    return told


def _reads(values: Values, text: str) -> npt.NDArray[np.bool_]:
    if values.dtype.kind == "b":
        return np.asarray(values == (text.lower() == "true")) & (text.lower() in ("true", "false"))
    if values.dtype.kind in "fiu":
        try:
            wanted = int(text) if values.dtype.kind in "iu" else float(text)
        except ValueError:
            return np.zeros(values.size, dtype=bool)
        return np.asarray(values == wanted, dtype=bool)
    return np.array([str(value).strip() == text for value in values], dtype=bool)


def numbers(
    source: Source, values: Values, rows: npt.NDArray[np.int64], column: str, missing: Sequence[str | float]
) -> Values:
    """Typed values as floats, NaN where `missing` says so. Raises InputError at the first that is no measurement."""
    if values.dtype.kind not in "fiu":
        raise InputError(f"{source.called}: column {column}: {values.dtype} is no number; map another column")
    made = values.astype(float)
    lost = np.zeros(made.size, dtype=bool)
    for code in missing:
        if isinstance(code, str) and code.casefold() in ("", "nan"):
            lost |= np.isnan(made)
        elif isinstance(code, str) and code.casefold() in ("inf", "-inf"):
            lost |= made == float(code)
        elif not isinstance(code, str):
            lost |= made == code
            if values.dtype.itemsize < 8 and values.dtype.kind == "f":  # -999.9 in single precision
                lost |= values == values.dtype.type(code)
    bad = np.flatnonzero(~np.isfinite(made) & ~lost)
    if bad.size:
        what = "nan" if np.isnan(made[bad[0]]) else f"{made[bad[0]]}"
        raise InputError(
            f"{source.place(int(rows[bad[0]]), column)}: {what} is no measurement; leave the row out, "
            f'or set missing = ["{what}"] in a map given as --map'
        )
    made[lost] = np.nan
    return made


class ArraySource(Source):
    """Arrays (n,) by name."""

    kind = "arrays"

    def __init__(self, columns: Mapping[str, npt.ArrayLike], called: str) -> None:
        self.called = called
        self._columns = columns

    @property
    def names(self) -> Sequence[str]:
        return list(self._columns)

    def locate(self, name: Name) -> int:
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
        return f"{column}[{row}]"


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
