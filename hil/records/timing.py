"""`timing.arrow`: wall times of each answered sample. Kept apart from the capture, which must not depend on
them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.records.layout import Column, Layout, block_rows_for
from hil.records.stream import read_blocks


def timing_layout(*, tick_rate_Hz: float, deadline_us: float | None = None) -> Layout:
    """Columns tick, t_receive_ns, t_send_ns, t_kernel_ns (monotonic clock; 0 where the kernel gave none).

    `deadline_us` is the turnaround the board allows before it holds the last drive, if there is one.
    """
    columns = (
        Column("tick", "i8"),
        Column("t_receive_ns", "i8", "ns"),
        Column("t_send_ns", "i8", "ns"),
        Column("t_kernel_ns", "i8", "ns"),
    )
    header = {"tick_rate_Hz": tick_rate_Hz, "deadline_us": deadline_us}
    return Layout("timing", columns, block_rows_for(tick_rate_Hz), header)


@dataclass(frozen=True)
class Timing:
    """Wall times of a run, read."""

    columns: Mapping[str, npt.NDArray[Any]]
    header: Mapping[str, Any]
    complete: bool

    @property
    def tick(self) -> npt.NDArray[np.int64]:
        """Sample counter (n,)."""
        return self.columns["tick"]

    @property
    def deadline_us(self) -> float | None:
        """Turnaround beyond which an answer is late, in µs."""
        deadline = self.header.get("deadline_us")
        return None if deadline is None else float(deadline)

    @cached_property
    def turnaround_us(self) -> npt.NDArray[np.float64]:
        """From the sample's arrival at the host to its answer's departure (n,), in µs."""
        elapsed: npt.NDArray[np.float64] = (self.columns["t_send_ns"] - self.columns["t_receive_ns"]) / 1e3
        return elapsed


def read_timing(path: Path) -> Timing:
    """Read a timing file, whole or cut."""
    blocks = read_blocks(path, "timing")
    return Timing(blocks.columns, blocks.header, blocks.complete)
