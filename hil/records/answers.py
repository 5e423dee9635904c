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
    gain_mode = timing.applied is not None
    block = int(timing.header.get("block", 0)) if gain_mode else 1
    if not block:
        return None
    sent = timing.tick
    size, missed = np.zeros(sent.size, np.int64), np.zeros(sent.size, bool)
    used = sent + (block if timing.deadline_us is not None else 1)  # gain mode: first tick computed with it
    first = last = None
    recorded = 0
    for tick, flags in rows:
        if not tick.size:
            continue
        first, last = int(tick[0]) if first is None else first, int(tick[-1])
        recorded += tick.size
        answer, found = _answer_to(tick, sent, block)
        size += np.bincount(answer[found], minlength=sent.size)
        if timing.applied is not None:
            seen = np.isin(used, tick, assume_unique=True)
            missed |= seen & (timing.applied != used)
        else:
            held = tick[(flags & RowFlag.LATE_ANSWER_HELD) != 0]
            answer, found = _answer_to(held - latency_ticks - 1, sent, block)
            missed[answer[found]] = True
    if first is None or last is None:
        return None
    ticks, answered, not_in_time = last - first + 1, int(size.sum()), int(size[missed].sum())
    late = not_in_time if board_late is None else min(board_late * block, answered)
    lost_to_board = max(not_in_time - late, 0)
    stopped = min(stopped, ticks - recorded)
    slow = 0 if timing.deadline_us is None else int(size[timing.turnaround_us > timing.deadline_us].sum())
    return Answers(
        ticks=ticks,
        in_time=answered - late - lost_to_board,
        late=late,
        unanswered=recorded - answered,
        lost_to_board=lost_to_board,
        lost_to_host=ticks - recorded - stopped,
        stopped=stopped,
        slow=slow,
    )


def _answer_to(tick: Ticks, sent: Ticks, block: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
    """Index (n,) of the answer to each of some ticks, and whether (n,) there was one."""
    answer = np.searchsorted(sent, tick)
    found: npt.NDArray[np.bool_] = answer < sent.size
    found[found] = sent[answer[found]] - tick[found] < block
    return answer, found
