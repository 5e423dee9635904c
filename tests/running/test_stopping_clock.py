"""docs/safety.md, The host, rule 5, by a clock that only waiting moves: when SAFE is said again, how long is heard, and
which rows are from before the stop.
"""

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from hil.running.safety import stopping
from hil.running.safety.stopping import Stopped, bring_to_safe
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed
from hil.wire.link import Link
from hil.wire.messages import Message, Safe, SafeReason, State, Status
from hil.wire.stream import Receiver, Transmitter
from tests.running.on_a_pty import rows, status

RATE_HZ, TICK = 400.0, 1000
DRIVEN, ZERO = (30, -7), (0, 0)
HUNG_UP = b"hung up"

Says = list[tuple[float, Message | bytes, int]]
"""Seconds from now, what is said then, and the tick in its header."""


class Board(Link):
    """The board's end: `answer` says, for the how manieth SAFE, what it will say."""

    name = "board"

    def __init__(self, answer: Callable[[int], Says], waits: bool = True) -> None:
        self.now_s = 500.0
        self.told: list[tuple[float, int]] = []
        self._answer, self._waits = answer, waits
        self._due: list[tuple[float, bytes]] = []
        self._rx, self._tx = Receiver(), Transmitter()

    def fileno(self) -> int | None:
        return 0 if self._waits else None

    def send(self, data: bytes) -> None:
        for item in self._rx.feed(data):
            assert isinstance(item.message, Safe)
            self.told.append((self.now_s - 500.0, item.message.reason))
            for delay_s, said, tick in self._answer(len(self.told)):
                self._due.append((self.now_s + delay_s, said if isinstance(said, bytes) else self._frame(said, tick)))
            self._due.sort(key=lambda one: one[0])

    def _frame(self, said: Message, tick: int) -> bytes:
        return self._tx.encode(said, tick)

    def receive(self, timeout_s: float | None) -> bytes:
        assert timeout_s is not None
        assert timeout_s >= 0.0
        if self._due and self._due[0][0] <= self.now_s + timeout_s:
            self.now_s = max(self.now_s, self._due[0][0])
            data = b""
            while self._due and self._due[0][0] <= self.now_s:
                data += self._due.pop(0)[1]
            if data.endswith(HUNG_UP):
                raise LinkClosed("board: the other end hung up")
            return data
        self.now_s += timeout_s if self._waits else 0.0
        return b""

    def close(self) -> None:
        """Nothing is open."""

    def stop(
        self,
        monkeypatch: pytest.MonkeyPatch,
        reason: int = SafeReason.HOST_REQUEST,
        patience_s: float = 2.0,
        **known: int,
    ) -> Stopped:
        monkeypatch.setattr(stopping, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        return bring_to_safe(Endpoint(self), reason, patience_s, rate_Hz=RATE_HZ, **{"newest": TICK} | known)

    @property
    def waited_s(self) -> float:
        return self.now_s - 500.0


def says(*said: tuple[float, Message | bytes, int]) -> Callable[[int], Says]:
    """In answer to the first SAFE."""
    return lambda number: list(said) if number == 1 else []


SAFE = status(tick=TICK)


@pytest.fixture
def patch(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    return monkeypatch


@pytest.mark.parametrize("patience_s", [2.0, 0.5])
def test_safe_is_said_eight_times_at_equal_distances(patch: pytest.MonkeyPatch, patience_s: float) -> None:
    board = Board(says())
    found = board.stop(patch, patience_s=patience_s)
    assert board.told == [(pytest.approx(k * patience_s / 8), SafeReason.HOST_REQUEST) for k in range(8)]
    assert board.waited_s == pytest.approx(patience_s)
    assert found == (None, False, f"the board did not answer SAFE, sent 8 times in {patience_s:g} s")


def test_in_process_eight_times_at_once(patch: pytest.MonkeyPatch) -> None:
    board = Board(says(), waits=False)
    assert "sent 8 times" in board.stop(patch).why
    assert [when for when, _ in board.told] == [0.0] * 8
    board = Board(lambda number: [(0.0, SAFE, TICK)] if number == 8 else [], waits=False)
    assert board.stop(patch).confirmed  # the last is as good as the first
    assert (len(board.told), board.waited_s) == (8, 0.0)


@pytest.mark.parametrize(("block", "seconds"), [(1, 0.1), (20, 0.1), (50, 0.25), (190, 0.95), (210, 1.0), (4000, 1.0)])
def test_it_listens_a_tenth_of_a_second_or_two_blocks_a_second_at_most(
    patch: pytest.MonkeyPatch, block: int, seconds: float
) -> None:
    board = Board(says((0.1, SAFE, TICK)))
    assert board.stop(patch, block=block) == (SAFE, True, "")
    assert board.waited_s == pytest.approx(0.1 + seconds)
    assert len(board.told) == 1


def test_in_process_there_is_nothing_to_wait_for(patch: pytest.MonkeyPatch) -> None:
    board = Board(says((0.0, SAFE, TICK)), waits=False)
    assert board.stop(patch) == (SAFE, True, "")
    board = Board(says((0.0, SAFE, TICK), (0.0, rows(DRIVEN), TICK + 2)), waits=False)
    assert not board.stop(patch).confirmed


@pytest.mark.parametrize(("late_s", "driven"), [(0.09, True), (0.11, False)])
def test_what_comes_while_it_listens_counts_and_nothing_after(
    patch: pytest.MonkeyPatch, late_s: float, driven: bool
) -> None:
    board = Board(says((0.0, SAFE, TICK), (late_s, rows(DRIVEN), TICK + 2)))
    assert board.stop(patch).confirmed is not driven


def test_the_answer_is_told_before_anything_is_listened_for(patch: pytest.MonkeyPatch) -> None:
    board = Board(says((0.2, SAFE, TICK)))
    told: list[tuple[Status, float]] = []
    patch.setattr(stopping, "time", SimpleNamespace(monotonic=lambda: board.now_s))
    bring_to_safe(
        Endpoint(board), SafeReason.HOST_REQUEST, 2.0, rate_Hz=RATE_HZ,
        answered=lambda status: told.append((status, board.waited_s)),
    )  # fmt: skip
    assert told == [(SAFE, pytest.approx(0.2))]
    assert board.waited_s == pytest.approx(0.3)


@pytest.mark.parametrize("state", [State.BOOT, State.IDLE, State.ARMED, State.RUNNING, 99])
def test_a_status_of_another_state_is_no_answer(patch: pytest.MonkeyPatch, state: int) -> None:
    board = Board(says((0.0, status(state, tick=TICK), TICK)))
    assert not board.stop(patch).confirmed


@pytest.mark.parametrize("reason", [*SafeReason, 99])
@pytest.mark.parametrize("asked", [r for r in SafeReason if r != SafeReason.NONE])
def test_a_reason_that_latches_is_answered_by_one_that_does(patch: pytest.MonkeyPatch, asked: int, reason: int) -> None:
    latching = {SafeReason.HOST_REQUEST, SafeReason.INTERRUPTED, SafeReason.RESIDUAL, SafeReason.FAULT}
    board = Board(says((0.0, status(reason=reason, tick=TICK), TICK)))
    assert board.stop(patch, asked).confirmed is (asked not in latching or reason in latching)


def test_what_stands_before_and_behind_the_answer_in_one_packet(patch: pytest.MonkeyPatch) -> None:
    """Before it a row tells how far the board is, behind it what it drives."""
    board = Board(says((0.0, rows(DRIVEN), TICK + 40), (0.0, status(tick=TICK + 40), TICK + 40)))
    assert board.stop(patch).confirmed
    board = Board(says((0.0, SAFE, TICK), (0.0, rows(ZERO), TICK + 1), (0.0, rows(DRIVEN), TICK + 2)))
    assert "SENSE of tick 1002 still shows a drive, codes 30 and -7" in board.stop(patch).why


@pytest.mark.parametrize("newest", [None, TICK - 10, TICK])
def test_rows_up_to_one_after_the_answers_tick_may_be_driven(patch: pytest.MonkeyPatch, newest: int | None) -> None:
    for tick, driven in ((TICK, False), (TICK + 1, False), (TICK + 2, True)):
        board = Board(says((0.2, SAFE, TICK), (0.2, rows(DRIVEN), tick)))
        assert board.stop(patch, newest=newest).confirmed is not driven


def test_no_further_ahead_than_time_that_passed_and_two_blocks(patch: pytest.MonkeyPatch) -> None:
    """1.5 times the time that passed, as a clock may be quick, two blocks and two ticks: an answer whose tick is
    further ahead is not believed, and the newest row stands.
    """
    after_s, block = 0.2, 10
    most = round(1.5 * after_s * RATE_HZ) + 2 * block + 2
    for ahead, believed in ((0, True), (most, True), (most + 1, False), (10 * most, False)):
        board = Board(says((after_s, status(tick=TICK + ahead), TICK), (after_s, rows(DRIVEN), TICK + 2)))
        assert board.stop(patch, block=block).confirmed is (believed and ahead >= 1)
    for behind in (1, 500):
        board = Board(says((after_s, status(tick=TICK - behind), TICK), (after_s, rows(DRIVEN), TICK + 1)))
        assert board.stop(patch, block=block).confirmed  # the newest row and the one after it are from before


def test_rows_before_the_answer_move_what_is_the_newest_forward_only(patch: pytest.MonkeyPatch) -> None:
    for newest, heard, expected in ((TICK, TICK + 5, TICK + 6), (TICK + 5, TICK, TICK + 6), (None, TICK, TICK + 1)):
        for tick, driven in ((expected, False), (expected + 1, True)):
            board = Board(
                says((0.0, rows(ZERO), heard), (0.0, status(tick=TICK - 900), TICK), (0.0, rows(DRIVEN), tick))
            )
            assert board.stop(patch, newest=newest).confirmed is not driven


def test_of_a_block_the_rows_after_the_stop_and_the_last_tick_of_it(patch: pytest.MonkeyPatch) -> None:
    block = rows(DRIVEN, DRIVEN, ZERO, (0, 5), (7, 0), ZERO)  # ticks TICK … TICK + 5
    board = Board(says((0.0, SAFE, TICK), (0.0, block, TICK), (0.01, rows((9, 9)), TICK + 6)))
    assert board.stop(patch) == (
        SAFE, False, "STATUS says SAFE, yet SENSE of tick 1005 still shows a drive, codes 0 and 5"
    )  # fmt: skip
    board = Board(says((0.0, SAFE, TICK), (0.0, rows(DRIVEN, DRIVEN), TICK)))
    assert board.stop(patch) == (SAFE, True, "")
    board = Board(says((0.0, SAFE, TICK), (0.0, rows(DRIVEN, DRIVEN, ZERO), TICK)))
    assert board.stop(patch) == (SAFE, True, "the board goes on streaming in SAFE")


@pytest.mark.parametrize(
    ("last_s", "codes", "told"),
    [
        (0.95, (30, -7), False),
        (1.05, (30, -7), True),
        (1.05, (0, -7), True),
        (1.05, (30, 0), True),
        (1.9, (0, 0), False),
    ],
)
def test_without_an_answer_the_newest_row_of_the_second_half_tells(
    patch: pytest.MonkeyPatch, last_s: float, codes: tuple[int, int], told: bool
) -> None:
    board = Board(says((0.5, rows((1, 1)), TICK), (last_s, rows(ZERO, codes), TICK + 1)))
    why = board.stop(patch).why
    assert (f", and SENSE still shows a drive, codes {codes[0]} and {codes[1]}" in why) == told
    assert why.startswith("the board did not answer SAFE, sent 8 times in 2 s")


def test_without_an_answer_and_without_a_row_no_drive_is_claimed(patch: pytest.MonkeyPatch) -> None:
    assert Board(says()).stop(patch).why == "the board did not answer SAFE, sent 8 times in 2 s"


def test_a_link_that_hangs_up_after_the_answer_leaves_it_standing(patch: pytest.MonkeyPatch) -> None:
    board = Board(says((0.1, SAFE, TICK), (0.15, HUNG_UP, 0)))
    assert board.stop(patch) == (SAFE, True, "")
    board = Board(says((0.1, SAFE, TICK), (0.12, rows(DRIVEN), TICK + 2), (0.15, HUNG_UP, 0)))
    assert not board.stop(patch).confirmed
    board = Board(says((0.1, HUNG_UP, 0)))
    assert board.stop(patch) == (
        None, False, "the board cannot be told SAFE any more: board: the other end hung up"
    )  # fmt: skip


def test_blocks_of_one_row_where_nobody_says_otherwise(patch: pytest.MonkeyPatch) -> None:
    """Then an answer may be as far ahead as two ticks and two: a driven row beyond is one from after it."""
    for ahead, believed in ((4, True), (5, False)):
        board = Board(says((0.0, status(tick=TICK + ahead), TICK), (0.0, rows(DRIVEN), TICK + 3)))
        assert board.stop(patch).confirmed is believed
