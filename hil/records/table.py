"""What the records of a run have in common: rows at ticks, in named columns, and what their file says of them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.records.blocks import LAST_TICK, Columns, between, first_tick_since, part_of, pieces_of, read_blocks, rows_of


def scored_from_s(first_s: float, settle_s: float, tick_rate_Hz: float) -> float:
    """Bench time from which a run is judged: `settle_s` after its first row, at bench time `first_s`; a thousandth of a
    sample before, so that the row there counts whatever its time is rounded to.  A board's time goes on from one run
    to the next.
    """
    return first_s + settle_s - 1e-3 / tick_rate_Hz


def cut_after(rows: int) -> str:
    """What is said of a record without its end marker, of which so many rows are there."""
    return f"interrupted: it ends after row {rows}, without an end marker"


def cut_record(rows: int) -> str:
    """The same as a sentence of its own."""
    return f"the record was {cut_after(rows)}"


@dataclass(frozen=True)
class Table:
    """A record, read. `complete` is False when it was interrupted (its end marker is missing).

    Its columns are read when asked for: what is large is gone through in `pieces`.
    """

    KIND: ClassVar[str]

    columns: Columns
    header: Mapping[str, Any]
    complete: bool

    @classmethod
    def read(cls, path: Path) -> Self:
        """The file of its kind at `path`, whole or cut. Raises InputError as `read_blocks`, and where it lacks what
        belongs there."""
        blocks = read_blocks(path, cls.KIND)
        table = cls(blocks.columns, blocks.header, blocks.complete)
        if flaw := table._flaw():
            raise InputError(f"{path}: {flaw}")
        return table

    def _flaw(self) -> str:
        """What it lacks and what to do about it; "" where nothing is missing."""
        return ""

    def __len__(self) -> int:
        return rows_of(self.columns)

    @property
    def cut(self) -> str:
        """That the record, which this is as it was read, was interrupted; "" of a whole one."""
        return "" if self.complete else cut_record(len(self))

    @property
    def axes(self) -> int:
        """Number of sense axes, 1 or 2; 0 for a sensor that puts out rates (`hil.records.rates`)."""
        return int(self.header["axes"])

    @property
    def tick_rate_Hz(self) -> float:
        """Ticks per second of bench time; for a record that is not uniform their mean."""
        return float(self.header["tick_rate_Hz"])

    @property
    def tick(self) -> npt.NDArray[np.int64]:
        """Sample counter (n,), unwrapped to 64 bits."""
        return self.columns["tick"]

    @cached_property
    def t_s(self) -> npt.NDArray[np.float64]:
        """Bench time (n,) in seconds."""
        return self.tick / self.tick_rate_Hz

    def part(self, start: int, stop: int) -> Self:
        """Rows [start, stop); ticks and times stay as they are."""
        return self._of(part_of(self.columns, start, stop))

    def pieces(self) -> Iterator[Self]:
        """The record in parts that memory always has room for, one after another."""
        for _, columns in pieces_of(self.columns):
            yield self._of(columns)

    def between(self, first_tick: int, last_tick: int) -> Self:
        """The rows of ticks first_tick … last_tick."""
        return self._of(between(self.columns, first_tick, last_tick))

    def since(self, t_s: float) -> Self:
        """The part from that bench time on."""
        return self.between(first_tick_since(t_s, self.tick_rate_Hz), LAST_TICK)

    def settled(self, settle_s: float) -> Self:
        """The part from `settle_s` after the first row on, see `scored_from_s`."""
        if not len(self):
            return self
        return self.since(scored_from_s(self.ends_s[0], settle_s, self.tick_rate_Hz))

    @property
    def ends(self) -> tuple[int, int]:
        """First and last tick of a record that is not empty."""
        last = len(self) - 1
        return int(self.part(0, 1).tick[0]), int(self.part(last, last + 1).tick[0])

    @property
    def ends_s(self) -> tuple[float, float]:
        """Bench times of both."""
        return float(self.part(0, 1).t_s[0]), float(self.part(len(self) - 1, len(self)).t_s[0])

    def _of(self, columns: Columns) -> Self:
        return replace(self, columns=columns)
