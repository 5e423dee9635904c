"""`trims.arrow`: the voltages of the trim outputs, one row for each change.

`tick` is the sample before which the observer was told, `acted_tick` the one from which on they were put out.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.records.layout import BENCH, TICK, Column, Layout
from hil.records.table import Table

TRIMS = "trims.arrow"
_BLOCK_ROWS = 64


def trims_layout(outputs: Sequence[Mapping[str, Any]], *, tick_rate_Hz: float) -> Layout:
    """Columns tick, acted_tick, and `NAME_V` of each of `outputs`, whose tables stand in the header: name, register,
    lowest_V, highest_V, settling_s, softening_per_s2_per_V2 and softening_u_per_s2_per_V2 as [xx, yy, xy].
    """
    columns = [TICK, Column("acted_tick", "i8", clock=BENCH)]
    columns += [Column(f"{one['name']}_V", "f8", "V") for one in outputs]
    return Layout("trims", tuple(columns), _BLOCK_ROWS, {"tick_rate_Hz": tick_rate_Hz, "outputs": list(outputs)})


class Trims(Table):
    """The changes of a run, read."""

    KIND = "trims"

    @property
    def outputs(self) -> list[dict[str, Any]]:
        """What stands in the header of each."""
        return list(self.header["outputs"])

    @property
    def volts(self) -> npt.NDArray[np.float64]:
        """(n, outputs)"""
        return np.column_stack([self.columns[f"{one['name']}_V"] for one in self.outputs])


def trims_beside(capture: Path) -> Trims | None:
    """The changes of the run that a capture is of, None where nothing was trimmed."""
    path = capture.parent / TRIMS
    return read_trims(path) if path.exists() else None


read_trims = Trims.read
