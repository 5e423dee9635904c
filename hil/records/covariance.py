"""`covariance.arrow`: the whole covariance of what is estimated, every so many samples, at ticks of the estimates.

With it and a truth the normalised estimation error squared of a run can be computed from its folder alone.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from hil.records.blocks import pieces_of
from hil.records.layout import TICK, Column, Layout, block_rows_for
from hil.records.table import Table

Floats = npt.NDArray[np.float64]

MEANING = (
    "covariance that the estimates have under the observer's gain, which the sd_ columns of the estimates are from; "
    "with fading memory it is not the filter's own P, which is about twice as large"
)
_PIECE_ROWS = 1 << 12
TRIANGLE = "upper, row by row, diagonal included"


def covariance_layout(names: Sequence[str], units: Sequence[str], *, tick_rate_Hz: float, every: int) -> Layout:
    """Columns tick, then A*B for each pair of entries A, B of the upper triangle, row by row, in unit(A)·unit(B), SI.

    `names` are those of the estimates' columns.
    """
    pairs = zip(*_triangle(len(names)), strict=True)
    columns = [Column(f"{names[i]}*{names[j]}", "f8", f"{units[i]}·{units[j]}") for i, j in pairs]
    header = {
        "tick_rate_Hz": tick_rate_Hz,
        "every": every,
        "entries": list(names),
        "units": list(units),
        "triangle": TRIANGLE,
        "meaning": MEANING,
    }
    return Layout("covariance", (TICK, *columns), block_rows_for(tick_rate_Hz / every), header)


def packed(covariance: Floats) -> list[float]:
    """The upper triangle of (n, n), row by row, as a row of the file holds it."""
    return list(covariance[_triangle(len(covariance))].tolist())


@dataclass(frozen=True)
class Covariance(Table):
    """Covariance of a run, read; its rows are at ticks that the estimates have too."""

    KIND = "covariance"

    def pieces(self) -> Iterator[Self]:
        """The record in parts that memory always has room for, one after another."""
        for _, columns in pieces_of(self.columns, _PIECE_ROWS):
            yield self._of(columns)

    @property
    def entries(self) -> tuple[str, ...]:
        """What is estimated, by the names of the estimates' columns: the order of the matrices."""
        return tuple(self.header["entries"])

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of each entry."""
        return tuple(self.header["units"])

    @cached_property
    def matrices(self) -> Floats:
        """The covariances (n, entries, entries), symmetric, SI."""
        n = len(self.entries)
        rows, columns = _triangle(n)
        full = np.empty((len(self), n, n))
        values = np.stack([self.columns[name] for name in list(self.columns)[1:]], axis=1)
        full[:, rows, columns] = values
        full[:, columns, rows] = values
        return full

    def _flaw(self) -> str:
        entries = list(self.header.get("entries", []))
        wanted = ["tick", *(f"{entries[i]}*{entries[j]}" for i, j in zip(*_triangle(len(entries)), strict=True))]
        if not entries or list(self.columns) != wanted:
            return "its columns are not those of its entries; run or replay again"
        return ""


read_covariance = Covariance.read


@cache
def _triangle(n: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    return np.triu_indices(n)
