"""`innovation.arrow`: measured minus predicted voltage at every sample, and how large it should have been."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hil.records.blocks import read_blocks
from hil.records.layout import TICK, Column, Layout, block_rows_for
from hil.records.table import Table

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
class Innovation(Table):
    """Innovation of a run, read."""

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
