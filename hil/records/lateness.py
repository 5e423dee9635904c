"""How late the answers of a run were, and what share of them would be late if the board waited longer.

An answer is late when it reaches the board after its effective tick. When it left is in `timing.arrow`, when its sample
was taken by the same clock as in the ledger (`ticks_on_clock`). The way to the board takes at least half the shortest
exchange of time. A sample that was not answered counts by the next answer that was sent: its own would have left then.
So one record gives the late share as a function of the time the board waits: latency ticks in force mode, a block in
gain mode.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.records.clock import student
from hil.records.result import Answers
from hil.records.runfolder import RunFolder
from hil.records.timing import Timing, seen_on_clock, ticks_on_clock

BATCH_S = 0.1
"""Stalls come in clusters: shares are averaged over pieces as long as this, and their scatter tells the error."""

_LEVEL = 0.95
_MOST_ROWS, _STRETCHES = 1 << 20, 16
Floats = npt.NDArray[np.float64]


class Share(NamedTuple):
    """A share of late answers: expected, and not exceeded in 95 % of such runs while the machine stays as it was."""

    expected: float
    at_most: float


@dataclass(frozen=True)
class Lateness:
    """Answers of one run in the order of time.

    Attributes:
        after_s: from each sample (in gain mode: the last row of each block) to its answer at the board (n,), in s.
        rows_s: of that, what the observer took for a block (n,), in s; zeros in force mode.
        rate_Hz, block: as run; block 1 in force mode.
        waits_s: how long the board waited, in s.
        counted: share of samples that the run counted as missed, without those that the link lost.
        lost: share of answers that the link lost, which no waiting cures.
    """

    after_s: Floats
    rows_s: Floats
    rate_Hz: float
    block: int
    waits_s: float
    counted: float
    lost: float

    @property
    def seconds(self) -> float:
        """Time that the answers cover."""
        return self.after_s.size * self.block / self.rate_Hz

    def share(self, waits_s: float, run_s: float, *, block: int | None = None) -> Share:
        """Late answers of a run of `run_s` whose board waits `waits_s`, in gain mode for blocks of another length.

        Expected is what the record says for that time, in proportion to what was counted at its own where more was
        counted than it says. `at_most` is the larger upper end of two one-sided 95 % prediction intervals. One is by
        the scatter of pieces of 0.1 s (Student's t; G. Hahn & W. Meeker, Statistical Intervals, 1991, section 4.8). The
        other is by the number of stalls, which may be few, or none (`_most_of_few`).
        """
        own = float(np.mean(self.after_s > self.waits_s))
        factor = max(self.counted / own, 1.0) if own else 1.0
        longer = (self.block if block is None else block) / self.block - 1.0
        late = self.after_s + longer * self.rows_s > waits_s
        pieces = min(max(round(self.seconds / BATCH_S), 2), late.size)
        means = np.array([piece.mean() for piece in np.array_split(late, pieces)])
        unexplained = 0.0 if own else self.counted  # why those were late is not known, so no waiting cures it
        expected = factor * float(late.mean()) + self.lost + unexplained
        both = 1.0 / pieces + BATCH_S / max(run_s, BATCH_S)
        scattered = float(late.mean()) + student(pieces - 1, _LEVEL) * float(means.std(ddof=1)) * math.sqrt(both)
        longest = float(stalls(self.after_s > self.waits_s).max(initial=1.0))
        few = _most_of_few(stalls(late), longest, both * pieces) / late.size
        at_most = factor * max(scattered, few) + self.lost + unexplained
        return Share(min(expected, 1.0), min(max(at_most, expected), 1.0))


def lateness_of(run: RunFolder, answers: Answers | None, *, since_s: float = 0.0) -> Lateness | None:
    """Of a recorded run, from `since_s` after its first answer on; None in lockstep, or where too little was answered.

    Of a very long record a million answers stand for all, in stretches spread over it.
    """
    timing, capture = run.timing, run.capture
    if timing is None or capture is None or answers is None or not answers.ticks:
        return None
    if (deadline_us := timing.deadline_us) is None:
        return None
    rate_Hz, block = float(timing.header["tick_rate_Hz"]), int(timing.header.get("block", 1))
    timing = timing.spread(_MOST_ROWS, _STRETCHES)
    if timing.tick.size < 2:
        return None
    clock, received = run.clock, timing.columns["t_receive_ns"]
    device = ticks_on_clock(
        timing.tick, received, rate_Hz, None if clock is None else seen_on_clock(clock, int(received[0]))
    )
    way_ns = 0.0 if clock is None or clock.fit is None else 0.5 * clock.fit.round_trip_ns
    first = int(timing.tick[0]) + math.ceil(since_s * rate_Hz)
    after, rows = [], []
    for part in timing.stretches():
        found = _of_stretch(part, first, block, device)
        after.append(found[0] + 1e-9 * way_ns)
        rows.append(found[1])
    after_s, rows_s = np.concatenate(after), np.concatenate(rows)
    if after_s.size < 2:
        return None
    return Lateness(
        after_s=after_s,
        rows_s=rows_s if block > 1 else np.zeros_like(rows_s),
        rate_Hz=rate_Hz,
        block=block,
        waits_s=1e-6 * deadline_us,
        counted=(answers.late + answers.unanswered) / answers.ticks,
        lost=answers.lost_to_board / answers.ticks,
    )


def _of_stretch(
    timing: Timing, first: int, block: int, device: Callable[[npt.NDArray[np.int64]], Floats]
) -> tuple[Floats, Floats]:
    """Of every sample or block from tick `first` on: time to its answer, and what the observer took, in s."""
    tick = timing.tick
    due = np.arange(tick[0], tick[-1] + 1, block)
    due = due[due >= first]
    answer = np.searchsorted(tick, due)
    sent, received, estimated = (timing.columns[f"t_{name}_ns"] for name in ("send", "receive", "estimate"))
    after = 1e-9 * (sent[answer] - device(due))
    return after, 1e-9 * (estimated - received)[answer]


def stalls(late: npt.NDArray[np.bool_]) -> Floats:
    """How many answers running were late (k,), of each stall."""
    edges = np.flatnonzero(np.diff(np.r_[False, late, False].astype(int)))
    return (edges[1::2] - edges[::2]).astype(float)


def _most_of_few(lengths: Floats, longest: float, factor: float) -> float:
    """Upper end for the sum of stalls that come at random, by those of one record (k,), the next as long as `longest`.

    The gamma interval of a weighted sum of Poisson counts (M. Fay & E. Feuer, "Confidence intervals for directly
    standardized rates", Statistics in Medicine 16, 1997), its variance by `factor` larger for the scatter of the run to
    come. Without any stall it is the rule of three: three of the longest.
    """
    from scipy.special import chdtri  # loads slowly

    longest = max(longest, float(lengths.max(initial=0.0)))
    total, spread = float(lengths.sum()) + longest, factor * float(np.sum(lengths**2)) + longest**2
    return float(0.5 * spread / total * chdtri(2.0 * total**2 / spread, 1.0 - _LEVEL))
