"""Numbers that instruments write where they have measured nothing."""

import re
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

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
