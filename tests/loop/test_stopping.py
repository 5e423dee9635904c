"""docs/safety.md, The host, rule 5: when a stop is confirmed. Over a pty, without a loop."""

import time
from collections.abc import Callable, Iterator

import pytest

from hil.loop.stopping import Stopped, bring_to_safe
from hil.wire.endpoint import Endpoint
from hil.wire.messages import Message, Safe, SafeReason, State
from hil.wire.serial_format import SERIAL
from tests.loop.on_a_pty import Far, connected, rows, status

TICK, RATE_HZ = 1000, 400.0
PATIENCE_S = 1.5  # a busy machine may leave the other end without a processor for half a second
ZERO, DRIVEN = (0, 0), (30, 0)
NOT_LATCHING = [SafeReason.NONE, SafeReason.WATCHDOG, SafeReason.LINK_LOST, 99]
LATCHING = [SafeReason.HOST_REQUEST, SafeReason.INTERRUPTED, SafeReason.RESIDUAL]


@pytest.fixture
def ends() -> Iterator[tuple[Endpoint, Far]]:
    with connected() as both:
        both[1].tick = TICK
        yield both


def stop(
    host: Endpoint, reason: int = SafeReason.HOST_REQUEST, *, newest: int | None = TICK, block: int = 1
) -> Stopped:
    return bring_to_safe(host, reason, PATIENCE_S, rate_Hz=RATE_HZ, block=block, newest=newest)


def to_safe(*said: Message) -> Callable[[Message], list[Message]]:
    """Answers SAFE by that and nothing else by anything."""
    return lambda message: list(said) if isinstance(message, Safe) else []


def streaming(
    far: Far, first: int, *said: Message, answer: Message | None = None
) -> Callable[[Message], list[Message]]:
    """Answers the first SAFE by STATUS, TICK in it, and by messages whose headers count from `first` on, one each."""

    def answered(message: Message) -> list[Message]:
        if isinstance(message, Safe) and far.count(Safe) == 1:
            far.say(status(tick=TICK) if answer is None else answer)
            for tick, row in enumerate(said, first):
                far.say(row, tick=tick)
        return []

    return answered


@pytest.mark.parametrize("reason", LATCHING)
def test_status_in_answer_and_no_drive_after_it_confirm_a_stop(ends: tuple[Endpoint, Far], reason: int) -> None:
    host, far = ends
    far.answer = to_safe(status(reason=reason, tick=TICK))
    begin = time.monotonic()
    found = stop(host, reason)
    assert time.monotonic() - begin >= 0.1  # so long it listens
    assert (found.confirmed, found.why) == (True, "")
    assert found.status is not None
    assert found.status.reason == reason
    assert [message for message in far.heard if isinstance(message, Safe)] == [Safe(reason)]


def test_it_listens_for_two_blocks_where_they_take_longer(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    far.answer = to_safe(status(tick=TICK))
    begin = time.monotonic()
    assert stop(host, block=50).confirmed
    assert 0.25 <= time.monotonic() - begin < 2.0


@pytest.mark.slow
def test_a_board_that_does_not_answer_is_not_confirmed(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    begin = time.monotonic()
    found = stop(host)
    assert time.monotonic() - begin >= PATIENCE_S
    assert (found.status, found.confirmed) == (None, False)
    told = far.count(Safe)
    assert 2 <= told <= 8  # a busy machine leaves some out
    assert found.why == f"the board did not answer SAFE, sent {told} times in {PATIENCE_S:g} s"


@pytest.mark.realtime
def test_it_is_told_eight_times(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    assert "sent 8 times in 2 s" in bring_to_safe(host, SafeReason.HOST_REQUEST, 2.0, rate_Hz=RATE_HZ).why
    assert far.count(Safe) == 8


class DeafInProcess:
    """The host's end of a board in this process that answers nothing: there is nothing to wait for."""

    name, format, arrived_ns, advice = "inproc:deaf", SERIAL, 0, ""

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def fileno(self) -> None:
        return None

    def send(self, data: bytes) -> None:
        self.sent.append(data)

    def receive(self, timeout_s: float | None) -> bytes:
        return b""

    def close(self) -> None:
        pass


def test_a_board_in_this_process_is_told_eight_times_at_once() -> None:
    link = DeafInProcess()
    begin = time.monotonic()
    found = bring_to_safe(Endpoint(link), SafeReason.HOST_REQUEST, 60.0, rate_Hz=RATE_HZ)
    assert time.monotonic() - begin < 30.0
    assert not found.confirmed
    assert len(link.sent) == 8


@pytest.mark.slow
def test_lines_lose_frames(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    far.answer = lambda message: [status(tick=TICK)] if far.count(Safe) == 5 else []
    assert stop(host).confirmed
    assert far.count(Safe) == 5


@pytest.mark.slow
@pytest.mark.parametrize("state", [State.BOOT, State.IDLE, State.ARMED, State.RUNNING, 99])
def test_a_status_of_another_state_is_no_answer(ends: tuple[Endpoint, Far], state: int) -> None:
    host, far = ends
    far.answer = to_safe(status(state))
    assert not stop(host).confirmed


@pytest.mark.slow
@pytest.mark.parametrize("reason", NOT_LATCHING)
def test_a_reason_that_does_not_latch_answers_no_safe_that_does(ends: tuple[Endpoint, Far], reason: int) -> None:
    host, far = ends
    far.answer = to_safe(status(reason=reason))
    assert not stop(host).confirmed


@pytest.mark.parametrize("reason", [*LATCHING, SafeReason.FAULT, SafeReason.WATCHDOG, SafeReason.LINK_LOST])
def test_any_reason_answers_link_lost(ends: tuple[Endpoint, Far], reason: int) -> None:
    """It asks a board in SAFE why it is there, and changes nothing (The board, rule 5)."""
    host, far = ends
    far.answer = to_safe(status(reason=reason))
    found = stop(host, SafeReason.LINK_LOST)
    assert found.confirmed
    assert found.status is not None
    assert found.status.reason == reason


@pytest.mark.parametrize("drive", [(30, 0), (-30, 0), (0, 30), (0, -1)])
def test_a_row_sampled_after_it_that_shows_a_drive_confirms_nothing(
    ends: tuple[Endpoint, Far], drive: tuple[int, int]
) -> None:
    host, far = ends
    far.answer = streaming(far, TICK + 2, rows(drive), rows(ZERO))
    found = stop(host)
    assert not found.confirmed
    assert found.status is not None
    assert f"SENSE of tick {TICK + 2} still shows a drive, codes {drive[0]} and {drive[1]}" in found.why


def test_rows_from_before_it_may_show_one(ends: tuple[Endpoint, Far]) -> None:
    """So may the interval in which SAFE came: its row is the next."""
    host, far = ends
    far.answer = streaming(far, TICK - 3, *[rows(DRIVEN)] * 5)
    found = stop(host, newest=TICK - 4)
    assert (found.confirmed, found.why) == (True, "")


def test_rows_without_a_drive_are_told_and_confirm_it(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    far.answer = streaming(far, TICK + 2, rows(ZERO), rows(ZERO))
    found = stop(host)
    assert found.confirmed
    assert "goes on streaming in SAFE" in found.why


def test_of_a_block_only_the_rows_after_it_tell(ends: tuple[Endpoint, Far]) -> None:
    """The block of ticks TICK - 2 … TICK + 3: driven up to the row of the interval in which SAFE came, or beyond."""
    for driven, confirmed in ((4, True), (5, False)):
        with connected() as (host, far):
            far.tick = TICK
            block = rows(*[DRIVEN] * driven, *[ZERO] * (6 - driven))
            far.answer = streaming(far, TICK - 2, block)
            assert stop(host, newest=TICK - 3, block=6).confirmed is confirmed


@pytest.mark.parametrize("claimed", [TICK + 5000, TICK - 500])
def test_a_tick_that_cannot_be_does_not_hide_a_drive(ends: tuple[Endpoint, Far], claimed: int) -> None:
    """STATUS with a tick far ahead would make every row after it one from before; with one long past, a row that was on
    its way one from after it.
    """
    host, far = ends
    far.answer = streaming(far, TICK + 40, rows(DRIVEN), answer=status(tick=claimed))
    assert not stop(host).confirmed
    with connected() as (host, far):
        far.tick = TICK
        far.answer = streaming(far, TICK, rows(DRIVEN), answer=status(tick=claimed))
        assert stop(host).confirmed


@pytest.mark.slow
@pytest.mark.parametrize("drive", [(30, -7), (30, 0), (0, -7)])
def test_a_board_that_does_not_answer_and_drives_on_is_told_as_such(
    ends: tuple[Endpoint, Far], drive: tuple[int, int]
) -> None:
    host, far = ends

    def drives(message: Message) -> list[Message]:
        far.tick += 1
        return [rows(drive)]

    far.answer = drives
    assert stop(host).why.endswith(f"and SENSE still shows a drive, codes {drive[0]} and {drive[1]}")
    assert far.count(Safe) <= 8  # however much it says


@pytest.mark.slow
def test_one_that_does_not_answer_and_streams_no_drive_is_not_called_driven(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    far.answer = to_safe(rows(ZERO))
    assert "still shows a drive" not in stop(host).why


@pytest.mark.slow
def test_rows_that_may_be_from_before_safe_reached_it_say_nothing(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    far.answer = lambda message: [rows(DRIVEN)] if far.count(Safe) == 1 else []
    assert "still shows a drive" not in stop(host).why


def test_a_link_that_hangs_up_confirms_nothing(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    far.end()
    found = stop(host)
    assert (found.status, found.confirmed) == (None, False)
    assert "cannot be told SAFE any more" in found.why


@pytest.mark.slow
def test_a_drive_before_a_late_answer_is_none_after_it(ends: tuple[Endpoint, Far]) -> None:
    """The board's clock went on while it did not answer: rows up to the tick of its answer were sampled before it."""
    host, far = ends

    def late(message: Message) -> list[Message]:
        if isinstance(message, Safe) and far.count(Safe) == 5:
            far.say(status(tick=TICK + 60))
            far.say(rows(DRIVEN), tick=TICK + 30)
        return []

    far.answer = late
    found = stop(host)
    assert (found.confirmed, found.why) == (True, "")
