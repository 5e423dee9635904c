"""docs/safety.md, The host, rule 5: when a stop is confirmed, over a pty; test_stopping_clock.py has each case."""

import time
from collections.abc import Callable, Iterator

import pytest

from hil.running.safety.stopping import Stopped, bring_to_safe
from hil.wire.endpoint import Endpoint
from hil.wire.messages import Message, Safe, SafeReason
from tests.running.on_a_pty import Far, connected, rows, status

TICK, RATE_HZ = 1000, 400.0
PATIENCE_S = 1.5  # a busy machine may leave the other end without a processor for half a second
ZERO, DRIVEN = (0, 0), (30, 0)
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


@pytest.mark.slow
def test_lines_lose_frames(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    far.answer = lambda message: [status(tick=TICK)] if far.count(Safe) == 5 else []
    assert stop(host).confirmed
    assert far.count(Safe) == 5


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
