"""Numbers that can be read in two ways, or may be none: refused, with the key that says which."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.importing.naming import Part
from hil.importing.source import Source, Table
from hil.importing.text_source import TextSource

_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}")
_WHOLE = re.compile(r"[+-]?\d{1,3}")
_SOME = 1000


def require_measured(
    source: Source,
    part: Part,
    values: npt.NDArray[np.float64],
    rows: npt.NDArray[np.int64],
    listed: Sequence[str | float] | None,
    *,
    is_mapped: bool,
) -> None:
    """Refuse a column with a number that stands for no measurement and is not in `listed`, the map's `missing`."""
    found = first_code(values)
    if found is None:
        return
    where = "" if is_mapped else " in a map given as --map"
    remedy = f"set missing = [{found.code!r}]{where}" if listed is None else f"add {found.code!r} to missing"
    raise InputError(
        f"{source.place(int(rows[found.row]), part.called)}: {found.code:.12g} stands for no measurement where "
        f"instruments write; {remedy} to have its rows as lost, or set missing = [] if it was measured"
    )


def require_finite(
    source: Source, part: Part, values: npt.NDArray[np.float64], table: Table, lost: npt.NDArray[np.bool_]
) -> None:
    """Refuse numbers (n,) that their conversion has made infinite; `lost` rows are passed over."""
    bad = np.flatnonzero(~np.isfinite(values) & ~lost)
    if bad.size:
        place = source.place(int(table.rows[bad[0]]), part.called)
        raise InputError(f"{place}: no finite number in {part.source.unit}; correct scale, offset or unit")


def require_no_thousands(source: TextSource, part: Part, values: npt.NDArray[np.float64]) -> None:
    """Refuse a column whose points may stand between thousands: whole numbers of up to three digits, and others with
    exactly three digits behind the point and none that begins with 0.
    """
    for some in (values[:_SOME], values):
        size = np.abs(some[np.isfinite(some)])
        whole = size == np.round(size)
        if (
            np.any(np.abs(size * 1e3 - np.round(size * 1e3)) > 1e-6)
            or np.any(size >= 1000.0)
            or np.any(size[~whole] < 1.0)
        ):
            return
    if whole.all() or not whole.any():
        return
    grouped = 0
    first: tuple[int, str] | None = None
    for line, text in source.texts(part.at):
        if _GROUPED.fullmatch(text):
            grouped, first = grouped + 1, first or (line, text)
        elif not _WHOLE.fullmatch(text):
            return
    if first is not None and grouped < len(values):
        plain = first[1].replace(".", "")
        raise InputError(
            f"{source.place(first[0], part.called)}: '{first[1]}' may be {plain}, with a point between thousands; "
            'set thousands = "." of this column in the map if it is, or decimal = "." if not'
        )


BEYOND = 1e30
"""No quantity in any unit is so large: SCPI's 9.9E37 and 9.91E37, and the largest of single precision, are."""
APART = 10.0
"""A code of nines is one where it lies so many times the range of all others away from them."""
RARE = 0.1
"""Beside one other value alone, a code stands in at most so large a share of the rows."""
_NINES = re.compile(r"-?9{3,}(\.(25|9+))?")


class Found(NamedTuple):
    """The first row (from 0) that holds such a number, and the number."""

    row: int
    code: float


def first_code(values: npt.NDArray[np.float64]) -> Found | None:
    """The first number in a column (n,) that is no measurement; NaN are passed over.

    Beyond ±1e30 any is.  −999, 9999, −999.25 and their like (nines alone, three at least, with .25 or further nines)
    are where they lie apart: more than 10 times the range of all other values from the nearest of them; beside one
    other value alone, in at most a tenth of the rows.
    """
    finite = np.isfinite(values)
    beyond = np.flatnonzero(finite & (np.abs(values) >= BEYOND))
    if beyond.size:
        return Found(int(beyond[0]), float(values[beyond[0]]))
    measured = values[finite]
    if measured.size < 2:
        return None
    for end in (float(np.min(measured)), float(np.max(measured))):
        if not _NINES.fullmatch(f"{end:.10g}"):
            continue
        others = measured[measured != end]
        if not others.size:
            continue
        if np.ptp(others) == 0.0 and measured.size - others.size > RARE * measured.size:
            continue  # two levels, one of which is of nines
        if np.min(np.abs(others - end)) > APART * np.ptp(others):
            return Found(int(np.flatnonzero(values == end)[0]), end)
    return None
