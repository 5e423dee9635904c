"""What became of each sample of a run: one count, whose parts add up to the ticks of the run.

`docs/reference/run-folder.md` (What became of each sample) has the parts in words. An answer is a row of
`timing.arrow`: in force mode to one sample, in gain mode to the block of samples that ends at its tick. What the record
shows of an answer stands at its telltale: in force mode the row after the interval that begins at the answer's
effective tick, flagged where the board held an old drive; in gain mode the effective tick itself, from which the matrix
was used or not.
"""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from hil.records.capture import RowFlag
from hil.records.result import Answers
from hil.records.timing import Timing

Ticks = npt.NDArray[np.int64]


def count_answers(
    rows: Iterable[tuple[Ticks, npt.NDArray[np.uint8]]],
    timing: Timing,
    latency_ticks: int,
    *,
    stopped: int = 0,
    board_late: int | None = None,
) -> Answers | None:
    """The count of a run; None where nothing was recorded, or in gain mode the record is too old to tell.

    Args:
        rows: ticks (n,) and flags (n,) of the capture, in pieces of any size, in their order.
        timing: the answers that were sent.
        latency_ticks: from a sample to the interval that its answer acts on.
        stopped: ticks of the gaps in which the board was SAFE, by the loop's own count.
        board_late: answers that the board says came too late, in this run; None where it said nothing.
    """
    gain_mode = _has_ledger(timing)
    block = int(timing.header.get("block", 0)) if gain_mode else 1
    if not block:
        return None
    used_after = (block if timing.deadline_us is not None else 1) if gain_mode else latency_ticks + 1
    window = _Window(timing, used_after)
    first = last = None
    recorded = 0
    for tick, flags in rows:
        if not tick.size:
            continue
        first, last = int(tick[0]) if first is None else first, int(tick[-1])
        recorded += tick.size
        window.reach(last)
        answer, found = _answer_to(tick, window.sent, block)
        window.size += np.bincount(answer[found], minlength=window.sent.size)
        if window.applied is not None:
            used = window.sent + used_after  # first tick computed with it
            seen = np.isin(used, tick, assume_unique=True)
            window.missed |= seen & (window.applied != used)
        else:
            held = tick[(flags & RowFlag.LATE_ANSWER_HELD) != 0]
            answer, found = _answer_to(held - used_after, window.sent, block)
            window.missed[answer[found]] = True
        window.settle(last)
    if first is None or last is None:
        return None
    window.settle(None)
    ticks, answered, not_in_time = last - first + 1, window.answered, window.not_in_time
    late = not_in_time if board_late is None else min(board_late * block, answered)
    lost_to_board = max(not_in_time - late, 0)
    stopped = min(stopped, ticks - recorded)
    return Answers(
        ticks=ticks,
        in_time=answered - late - lost_to_board,
        late=late,
        unanswered=recorded - answered,
        lost_to_board=lost_to_board,
        lost_to_host=ticks - recorded - stopped,
        stopped=stopped,
        slow=window.slow,
    )


class _Window:
    """The answers that the rows at hand may belong to; those before have been counted, those after are not read yet.

    Attributes:
        sent: ticks (n,) of the answers.
        applied: ticks (n,) from which they were used, in gain mode.
        size: samples (n,) that each is to, so far.
        missed: whether (n,) the record shows that it was not used in time.
        answered, not_in_time, slow: samples of the answers that have been counted.
    """

    def __init__(self, timing: Timing, telltale: int) -> None:
        self._pieces = timing.pieces()
        self._telltale = telltale
        self._deadline_us = timing.deadline_us
        self.sent: Ticks = np.empty(0, np.int64)
        self.applied: Ticks | None = np.empty(0, np.int64) if _has_ledger(timing) else None
        self.size: Ticks = np.empty(0, np.int64)
        self.missed = np.empty(0, bool)
        self._slow = np.empty(0, bool)
        self.answered = self.not_in_time = self.slow = 0

    def reach(self, tick: int) -> None:
        """Read on until there is the answer to `tick`, or no more."""
        while not self.sent.size or self.sent[-1] < tick:
            piece = next(self._pieces, None)
            if piece is None:
                return
            more = piece.tick
            self.sent = np.concatenate([self.sent, more])
            self.size = np.concatenate([self.size, np.zeros(more.size, np.int64)])
            self.missed = np.concatenate([self.missed, np.zeros(more.size, bool)])
            if self.applied is not None and piece.applied is not None:
                self.applied = np.concatenate([self.applied, piece.applied])
            slow = np.zeros(more.size, bool) if self._deadline_us is None else piece.turnaround_us > self._deadline_us
            self._slow = np.concatenate([self._slow, slow])

    def settle(self, last: int | None) -> None:
        """Count the answers that no row after `last` has anything to say of, and let them go; None: all of them."""
        done = self.sent.size if last is None else int(np.searchsorted(self.sent, last - self._telltale, "right"))
        size = self.size[:done]
        self.answered += int(size.sum())
        self.not_in_time += int(size[self.missed[:done]].sum())
        self.slow += int(size[self._slow[:done]].sum())
        self.sent, self.size = self.sent[done:], self.size[done:]
        self.missed, self._slow = self.missed[done:], self._slow[done:]
        if self.applied is not None:
            self.applied = self.applied[done:]


def _has_ledger(timing: Timing) -> bool:
    """Whether it is of a run in gain mode."""
    return "applied_tick" in timing.columns


def _answer_to(tick: Ticks, sent: Ticks, block: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
    """Index (n,) of the answer to each of some ticks, and whether (n,) there was one."""
    answer = np.searchsorted(sent, tick)
    found: npt.NDArray[np.bool_] = answer < sent.size
    found[found] = sent[answer[found]] - tick[found] < block
    return answer, found
