"""`timing.arrow`: wall times of each answered sample, in gain mode of each block. Kept apart from the capture, which
must not depend on them.

A row is a ledger: sampled by the device at `tick` (a block's last row), received, estimated, the answer sent; in gain
mode the matrix was first computed with at `applied_tick`. All times are on the host's monotonic clock. Ticks are put on
it by the fastest arrivals, and by the board's own word where it has given its time and its tick (`clock.arrow`) and
that leaves the wire more: what has been sampled by then was sampled no later.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.records.blocks import part_of
from hil.records.clock import ClockRecord, student
from hil.records.layout import BENCH, HOST, TICK, Column, Layout, block_rows_for
from hil.records.table import Table

_PARTS = 10
_FAR = 1000


def timing_layout(*, tick_rate_Hz: float, deadline_us: float | None = None) -> Layout:
    """Columns tick, t_receive_ns (by the kernel's stamp where the link has one), t_estimate_ns, when the observer was
    done, t_send_ns.

    `deadline_us` is the turnaround the board allows before it holds the last drive, if there is one.
    """
    columns = (
        TICK,
        Column("t_receive_ns", "i8", "ns", clock=HOST),
        Column("t_estimate_ns", "i8", "ns", clock=HOST),
        Column("t_send_ns", "i8", "ns", clock=HOST),
    )
    header = {"tick_rate_Hz": tick_rate_Hz, "deadline_us": deadline_us}
    return Layout("timing", columns, block_rows_for(tick_rate_Hz), header)


def ledger_layout(*, tick_rate_Hz: float, block: int, deadline_us: float | None = None) -> Layout:
    """The same for blocks of samples, with applied_tick, the first tick computed with the block's matrix (-1: not
    seen; it was replaced before, or did not arrive).
    """
    timing = timing_layout(tick_rate_Hz=tick_rate_Hz, deadline_us=deadline_us)
    columns = (*timing.columns, Column("applied_tick", "i8", clock=BENCH))
    return Layout("timing", columns, block_rows_for(tick_rate_Hz / block), {**timing.header, "block": block})


@dataclass(frozen=True)
class Timing(Table):
    KIND = "timing"

    def spread(self, rows: int, stretches: int) -> "Timing":
        """So many rows at most, in stretches spread over the record; all of them where there are no more."""
        if len(self) <= rows:
            return self
        each = rows // stretches
        starts = [round(k * (len(self) - each) / (stretches - 1)) for k in range(stretches)]
        names = list(self.columns)
        parts = [part_of(self.columns, start, start + each) for start in starts]
        return Timing({name: np.concatenate([part[name] for part in parts]) for name in names}, self.header, False)

    def stretches(self) -> Iterator["Timing"]:
        """Its parts, cut where more than a thousand ticks are missing: the board stopped, or what lay between was left
        out."""
        cuts = np.flatnonzero(np.diff(self.tick) > _FAR) + 1
        for start, stop in pairwise((0, *cuts.tolist(), len(self))):
            yield self.part(start, stop)

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

    @property
    def applied(self) -> npt.NDArray[np.int64] | None:
        """First tick at which each answer was used (n,), -1 where that is not known; None in force mode, where the
        capture tells."""
        return self.columns.get("applied_tick")

    def ledger_us(
        self, applied: npt.NDArray[np.int64], clock: ClockRecord | None = None
    ) -> dict[str, npt.NDArray[np.float64]]:
        """How long each block took in each of its stages, in µs, by stage: wire, estimate, send, apply, total; empty
        in lockstep, where ticks follow no clock. `applied` (n,) is the tick at which each answer was first used, -1
        where that is not known; such blocks are left out. `clock` are the exchanges of time with the board.
        """
        known = applied >= 0
        if self.deadline_us is None or not known.any() or "t_estimate_ns" not in self.columns:
            return {}
        tick, received, estimated, sent = (
            self.columns[name][known] for name in ("tick", "t_receive_ns", "t_estimate_ns", "t_send_ns")
        )
        applied = applied[known]
        seen = None if clock is None else seen_on_clock(clock, received[0])
        device = ticks_on_clock(tick, received, float(self.header["tick_rate_Hz"]), seen)
        stages = {
            "wire": received - device(tick),
            "estimate": estimated - received,
            "send": sent - estimated,
            "apply": device(applied) - sent,
            "total": device(applied) - device(tick),
        }
        return {name: elapsed / 1e3 for name, elapsed in stages.items()}


class Seen(NamedTuple):
    """Ticks (n,) that had been sampled by host times (n,), in ns since `since_ns`."""

    tick: npt.NDArray[np.int64]
    host_ns: npt.NDArray[np.float64]
    since_ns: int


def seen_on_clock(clock: ClockRecord, begin_ns: int) -> Seen | None:
    """By when the board's ticks had come, by its own clock, put on the host's; None where that is not known.

    Only exchanges after the given host time count: before the first tick a board says 0, whatever the time. One that
    stands still says an old tick, which is true as well.
    """
    fit = clock.fit
    if fit is None:
        return None
    streaming = clock.columns["t_send_ns"] > begin_ns
    return Seen(clock.tick[streaming], fit.host_ns(clock.columns["board_ns"][streaming]), fit.at_host_ns)


def ticks_on_clock(
    tick: npt.NDArray[np.int64], received_ns: npt.NDArray[np.int64], tick_rate_Hz: float, seen: Seen | None = None
) -> Callable[[npt.NDArray[np.int64]], npt.NDArray[np.float64]]:
    """The host's clock in ns as a function of the device's tick, from when blocks arrived: a line below all arrivals.

    Its slope, which takes in the skew of the two clocks, is that of the earliest arrivals in each of ten parts of the
    record; its height such that the fastest block took no time, or lower where `seen` lies below the line.
    """
    nominal = 1e9 / tick_rate_Hz
    delay = (received_ns - received_ns[0]) - (tick - tick[0]) * nominal
    earliest = _earliest(delay)
    skew = 0.0
    if len(earliest) == _PARTS:
        skew = float(np.polyfit((tick[earliest] - tick[0]).astype(float), delay[earliest], 1)[0])
    height = float(np.min(delay - skew * (tick - tick[0])))
    if seen is not None and seen.tick.size:
        late = seen.host_ns - float(received_ns[0] - seen.since_ns) - (seen.tick - tick[0]) * (nominal + skew)
        height = min(height, float(late.min()))
    return lambda ticks: received_ns[0] + height + (ticks - tick[0]) * (nominal + skew)


def rate_of_ticks(
    tick: npt.NDArray[np.int64], host_ns: npt.NDArray[np.int64], tick_rate_Hz: float
) -> tuple[float, float] | None:
    """By how much more ticks there are in a second of the host than declared, relative, and half its 95 % interval, by
    when (n,) the host had which tick (n,); None of too few. Through the earliest of each of ten parts goes a line.
    """
    if tick.size < _PARTS:
        return None
    declared = (tick - tick[0]) * (1e9 / tick_rate_Hz)
    delay = (host_ns - host_ns[0]) - declared
    earliest = _earliest(delay)
    x, y = declared[earliest], delay[earliest]
    (slope, height), moment = np.polyfit(x, y, 1), float(np.sum((x - x.mean()) ** 2))
    scatter = math.sqrt(float(np.sum((y - slope * x - height) ** 2)) / (_PARTS - 2))
    return 1.0 / (1.0 + float(slope)) - 1.0, student(_PARTS - 2) * scatter / math.sqrt(moment)


def _earliest(delay: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Of each of ten parts, the row with the least delay."""
    parts = [part for part in np.array_split(np.arange(delay.size), _PARTS) if part.size]
    return np.array([part[np.argmin(delay[part])] for part in parts])
