"""`timing.arrow`: wall times of each answered sample, in gain mode of each block. Kept apart from the capture, which
must not depend on them.

In gain mode a row is a ledger of one block: sampled by the device at `tick` (its last row), received, estimated, its
matrix sent and first computed with at `applied_tick`. Ticks are put on the host's clock by the fastest blocks: what a
block was slower than these is time on the wire.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.records.layout import Column, Layout, block_rows_for
from hil.records.stream import read_blocks

_PARTS = 10


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


def ledger_layout(*, tick_rate_Hz: float, block: int, deadline_us: float | None = None) -> Layout:
    """The same for blocks of samples, with t_estimate_ns, when the observer was done, and applied_tick, the first tick
    computed with the block's matrix (-1: not known, it was replaced before).
    """
    timing = timing_layout(tick_rate_Hz=tick_rate_Hz, deadline_us=deadline_us)
    columns = (*timing.columns, Column("t_estimate_ns", "i8", "ns"), Column("applied_tick", "i8"))
    return Layout("timing", columns, block_rows_for(tick_rate_Hz / block), timing.header)


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

    @cached_property
    def ledger_us(self) -> dict[str, npt.NDArray[np.float64]]:
        """How long each block took in each of its stages, in µs, by stage: wire, estimate, send, apply, total; empty
        where blocks were not accounted for, and in lockstep, where ticks follow no clock. Without blocks that are not
        known to have been applied.
        """
        if "applied_tick" not in self.columns or self.deadline_us is None:
            return {}
        known = self.columns["applied_tick"] >= 0
        tick, received, estimated, sent, applied = (
            self.columns[name][known] for name in ("tick", "t_receive_ns", "t_estimate_ns", "t_send_ns", "applied_tick")
        )
        if not tick.size:
            return {}
        device = ticks_on_clock(tick, received, float(self.header["tick_rate_Hz"]))
        stages = {
            "wire": received - device(tick),
            "estimate": estimated - received,
            "send": sent - estimated,
            "apply": device(applied) - sent,
            "total": device(applied) - device(tick),
        }
        return {name: elapsed / 1e3 for name, elapsed in stages.items()}


def ticks_on_clock(
    tick: npt.NDArray[np.int64], received_ns: npt.NDArray[np.int64], tick_rate_Hz: float
) -> Callable[[npt.NDArray[np.int64]], npt.NDArray[np.float64]]:
    """The host's clock in ns as a function of the device's tick, from when blocks arrived: a line below all arrivals.

    Its slope, which takes in the skew of the two clocks, is that of the earliest arrivals in each of ten parts of the
    record; its height such that the fastest block took no time.
    """
    nominal = 1e9 / tick_rate_Hz
    delay = (received_ns - received_ns[0]) - (tick - tick[0]) * nominal
    parts = [part for part in np.array_split(np.arange(tick.size), _PARTS) if part.size]
    earliest = np.array([part[np.argmin(delay[part])] for part in parts])
    skew = 0.0
    if len(earliest) == _PARTS:
        skew = float(np.polyfit((tick[earliest] - tick[0]).astype(float), delay[earliest], 1)[0])
    height = float(np.min(delay - skew * (tick - tick[0])))
    return lambda ticks: received_ns[0] + height + (ticks - tick[0]) * (nominal + skew)


def read_timing(path: Path) -> Timing:
    """Read a timing file, whole or cut."""
    blocks = read_blocks(path, "timing")
    return Timing(blocks.columns, blocks.header, blocks.complete)
