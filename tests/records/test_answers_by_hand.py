"""docs/reference/run-folder.md (What became of each sample): records of a few ticks, counted by hand.

In force mode with a latency of 2 the answer to tick m acts on the interval from m + 2 on, which the row of m + 3 shows.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from hil.records.capture import RowFlag
from hil.records.result import Answers
from hil.records.summary import count_answers
from hil.records.timing import Timing

HELD = int(RowFlag.LATE_ANSWER_HELD)
LATENCY = 2


def rows(recorded: Sequence[int], held: Sequence[int]) -> list[tuple[np.ndarray, np.ndarray]]:
    """A capture of these ticks; `held`: those whose row is flagged."""
    ticks = np.array(recorded, np.int64)
    return [(ticks, np.where(np.isin(ticks, held), HELD, 0).astype(np.uint8))]


def counted(recorded: list[int], answered: list[int], held: Sequence[int] = (), **known: Any) -> Answers:
    """Of force mode, each answer after 100 µs, or as `after_us` has it; the board waits for 250."""
    after_us = known.pop("after_us", [100] * len(answered))
    columns = {"tick": np.array(answered, np.int64), "t_receive_ns": np.full(len(answered), 10**9)}
    columns["t_send_ns"] = columns["t_receive_ns"] + 1000 * np.array(after_us, np.int64)
    timing = Timing(columns, {"deadline_us": known.pop("deadline_us", 250.0)}, True)
    found = count_answers(rows(recorded, held), timing, LATENCY, **known)
    assert found is not None
    assert sum(found.parts.values()) == found.ticks
    return found


def parts(found: Answers) -> tuple[int, ...]:
    """in_time, late, unanswered, lost_to_board, lost_to_host, stopped."""
    return (
        found.in_time, found.late, found.unanswered, found.lost_to_board, found.lost_to_host, found.stopped
    )  # fmt: skip


TEN = list(range(100, 110))


def test_all_in_time() -> None:
    found = counted(TEN, TEN)
    assert (found.ticks, parts(found), found.slow) == (10, (10, 0, 0, 0, 0, 0), 0)


def test_a_sample_without_an_answer() -> None:
    assert parts(counted(TEN, [t for t in TEN if t not in (103, 104)])) == (8, 0, 2, 0, 0, 0)


@pytest.mark.parametrize("sample", [100, 104, 106])
def test_an_answer_whose_interval_was_held_was_not_in_time(sample: int) -> None:
    assert parts(counted(TEN, TEN, [sample + 3])) == (9, 1, 0, 0, 0, 0)


def test_a_flag_that_belongs_to_no_answer_counts_nothing() -> None:
    """Of a sample before the record, of one that was not answered, and of one that was lost."""
    assert parts(counted(TEN, TEN, [100, 102])) == (10, 0, 0, 0, 0, 0)
    assert parts(counted(TEN, [t for t in TEN if t != 104], [107])) == (9, 0, 1, 0, 0, 0)
    gone = [t for t in TEN if t != 104]
    assert parts(counted(gone, gone, [107])) == (9, 0, 0, 0, 1, 0)


def test_an_answer_without_its_row_was_in_time_unless_the_board_denies_it() -> None:
    gone = [t for t in TEN if t != 107]
    assert parts(counted(gone, gone)) == (9, 0, 0, 0, 1, 0)
    assert parts(counted(gone, gone, board_late=1)) == (8, 1, 0, 0, 1, 0)


@pytest.mark.parametrize(
    ("board_late", "late", "lost"), [(None, 3, 0), (3, 3, 0), (1, 1, 2), (0, 0, 3), (5, 5, 0), (99, 10, 0)]
)
def test_the_board_says_how_many_of_them_came_late(board_late: int | None, late: int, lost: int) -> None:
    found = counted(TEN, TEN, [103, 105, 109], board_late=board_late)
    assert parts(found) == (10 - late - lost, late, 0, lost, 0, 0)


@pytest.mark.parametrize(("told", "stopped"), [(0, 0), (2, 2), (3, 3), (9, 3)])
def test_of_the_gaps_the_loop_knows_which_were_stops(told: int, stopped: int) -> None:
    gone = [t for t in TEN if t not in (102, 103, 106)]
    found = counted(gone, gone, stopped=told)
    assert (found.ticks, parts(found)) == (10, (7, 0, 0, 0, 3 - stopped, stopped))


def test_slow_is_later_than_the_deadline_and_no_part_of_the_sum() -> None:
    found = counted(TEN[:4], TEN[:4], after_us=[249, 250, 251, 9000])
    assert (found.slow, parts(found)) == (2, (4, 0, 0, 0, 0, 0))
    assert counted(TEN[:4], TEN[:4], after_us=[9000] * 4, deadline_us=None).slow == 0


def test_from_the_first_row_to_the_last() -> None:
    """Answers to ticks that are not in the record count nothing, before it, in it and behind it."""
    found = counted([105, 106, 107, 109], [104, 105, 106, 107, 108, 109, 110])
    assert (found.ticks, parts(found)) == (5, (4, 0, 0, 0, 1, 0))


def test_nothing_recorded_nothing_counted() -> None:
    timing = Timing({name: np.empty(0, np.int64) for name in ("tick", "t_receive_ns", "t_send_ns")}, {}, True)
    assert count_answers([], timing, LATENCY) is None
    assert count_answers(rows([], []), timing, LATENCY) is None
    found = count_answers([*rows([], []), *rows(TEN, [])], timing, LATENCY)
    assert found is not None
    assert (found.ticks, found.unanswered, found.in_time) == (10, 10, 0)


# ---------------------------------------------------------------------------------------------------------- gain mode


def blocks(recorded: list[int], ends: list[int], applied: list[int], **known: Any) -> Answers | None:
    """Of blocks of 5; on wall time a matrix is due five ticks after its block, in lockstep at the next."""
    header = {"block": known.pop("block", 5), "deadline_us": known.pop("deadline_us", 1000.0)}
    columns = {"tick": np.array(ends, np.int64), "applied_tick": np.array(applied, np.int64)}
    columns |= {"t_receive_ns": np.zeros(len(ends), np.int64), "t_send_ns": np.full(len(ends), 10**5)}
    return count_answers(rows(recorded, []), Timing(columns, header, True), 1, **known)


TWENTY = list(range(20))
ENDS = [4, 9, 14, 19]


@pytest.mark.parametrize(
    ("applied", "late"),
    [([9, 14, 19, 24], 0), ([9, 15, 19, 24], 5), ([9, -1, -1, 24], 10), ([9, 14, 19, -1], 0), ([8, 14, 19, 24], 5)],
)
def test_a_block_is_in_time_if_its_matrix_was_in_force_at_its_tick(applied: list[int], late: int) -> None:
    found = blocks(TWENTY, ENDS, applied)
    assert found is not None
    assert parts(found) == (20 - late, late, 0, 0, 0, 0)


def test_in_lockstep_it_is_due_at_the_next_tick() -> None:
    found = blocks(TWENTY, ENDS, [5, 10, 15, 20], deadline_us=None)
    assert found is not None
    assert parts(found) == (20, 0, 0, 0, 0, 0)
    late = blocks(TWENTY, ENDS, [9, 14, 19, 24], deadline_us=None)
    assert late is not None
    assert parts(late) == (5, 15, 0, 0, 0, 0)


def test_every_sample_of_a_block_goes_where_the_block_goes() -> None:
    found = blocks(TWENTY, [4, 14, 19], [9, -1, 24], board_late=0)
    assert found is not None
    assert parts(found) == (10, 0, 5, 5, 0, 0)
    one_late = blocks(TWENTY, ENDS, [9, -1, -1, 24], board_late=1)
    assert one_late is not None
    assert parts(one_late) == (10, 5, 0, 5, 0, 0)


def test_a_sample_that_was_lost_from_a_block_is_lost_alone() -> None:
    found = blocks([t for t in TWENTY if t not in (6, 7)], ENDS, [9, -1, 19, 24])
    assert found is not None
    assert parts(found) == (15, 3, 0, 0, 2, 0)


def test_where_the_tick_at_which_it_was_due_is_missing_it_was_in_time() -> None:
    found = blocks([t for t in TWENTY if t != 14], ENDS, [9, -1, 19, 24])
    assert found is not None
    assert parts(found) == (19, 0, 0, 0, 1, 0)


def test_a_record_too_old_to_tell_is_not_counted() -> None:
    assert blocks(TWENTY, ENDS, ENDS, block=0) is None
