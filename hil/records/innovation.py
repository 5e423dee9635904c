"""`innovation.arrow`: measured minus predicted voltage at every sample, and how large it should have been."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.records.blocks import LAST_TICK, Columns, between, first_tick_since, part_of, pieces_of, read_blocks, rows_of
from hil.records.layout import TICK, Column, Layout, block_rows_for

_AXES = ("x", "y")


def innovation_layout(*, tick_rate_Hz: float, axes: int) -> Layout:
    """Columns tick, nu_x_V (nu_y_V), s_x_V (s_y_V), the latter the predicted standard deviations."""
    names = _AXES[:axes]
    columns = (
        TICK,
        *(Column(f"nu_{axis}_V", "f4", "V") for axis in names),
        *(Column(f"s_{axis}_V", "f4", "V") for axis in names),
    )
    header = {"tick_rate_Hz": tick_rate_Hz, "axes": axes}
    return Layout("innovation", columns, block_rows_for(tick_rate_Hz), header)


@dataclass(frozen=True)
class Innovation:
    """Innovation of a run, read."""

    columns: Columns
    header: Mapping[str, Any]
    complete: bool

    def __len__(self) -> int:
        return rows_of(self.columns)

    def part(self, start: int, stop: int) -> "Innovation":
        """Rows [start, stop)."""
        return Innovation(part_of(self.columns, start, stop), self.header, self.complete)

    def pieces(self) -> Iterator["Innovation"]:
        """The record in parts that memory always has room for, one after another."""
        for _, columns in pieces_of(self.columns):
            yield Innovation(columns, self.header, self.complete)

    @property
    def axes(self) -> int:
        """Number of sense axes."""
        return int(self.header["axes"])

    @property
    def tick_rate_Hz(self) -> float:
        """Samples per second of bench time."""
        return float(self.header["tick_rate_Hz"])

    @property
    def tick(self) -> npt.NDArray[np.int64]:
        """Sample counter (n,)."""
        return self.columns["tick"]

    @cached_property
    def t_s(self) -> npt.NDArray[np.float64]:
        """Bench time (n,) in seconds."""
        return self.tick / self.tick_rate_Hz

    def since(self, t_s: float) -> "Innovation":
        """The part from that bench time on."""
        first = first_tick_since(t_s, self.tick_rate_Hz)
        return Innovation(between(self.columns, first, LAST_TICK), self.header, self.complete)

    @cached_property
    def nu_V(self) -> npt.NDArray[np.float64]:
        """Innovation (n, axes) in volts."""
        return self._stack("nu")

    @cached_property
    def sd_V(self) -> npt.NDArray[np.float64]:
        """Its predicted standard deviation (n, axes) in volts."""
        return self._stack("s")

    def _stack(self, prefix: str) -> npt.NDArray[np.float64]:
        return np.stack([self.columns[f"{prefix}_{axis}_V"] for axis in _AXES[: self.axes]], 1).astype(float)


def read_innovation(path: Path) -> Innovation:
    """Read an innovation file, whole or cut."""
    blocks = read_blocks(path, "innovation")
    return Innovation(blocks.columns, blocks.header, blocks.complete)
