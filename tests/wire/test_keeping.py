"""What an endpoint keeps for a later call, and of how much it forgets the oldest."""

import numpy as np
import pytest

from hil.wire.endpoint import Endpoint, Exchange
from hil.wire.messages import Arm, RegisterRead, TimeSync
from hil.wire.sense import Sense
from hil.wire.stream import REPEAT_RUN, REPEAT_WINDOW, Received, Receiver, Transmitter
from tests.wire.test_endpoint import Script, board_frames


def row(tick: int) -> Received:
    return Received(tick, 0, Sense(np.array([[tick, 2, 3, 4]], np.int32), 2, 1))


def other(number: int) -> Received:
    return Received(0, 0, RegisterRead(number))


def test_a_thousand_messages_are_kept_then_the_oldest_are_forgotten() -> None:
    endpoint = Endpoint(Script())
    endpoint.keep([other(number) for number in range(1030)])
    assert [item.message for item in endpoint.poll(0.0)] == [RegisterRead(number) for number in range(6, 1030)]


def test_of_answers_about_the_time_the_last_sixty_four_are_kept() -> None:
    tx = Transmitter()
    link = Script(b"".join(tx.encode(TimeSync(number, 10 * number), 3) for number in range(70)))
    endpoint = Endpoint(link)
    endpoint.poll(0.0)
    heard = endpoint.received_ns
    assert list(endpoint.exchanges) == [Exchange(number, 10 * number, heard, 3) for number in range(6, 70)]


def test_the_time_is_asked_with_a_number_by_which_the_answer_is_known() -> None:
    link = Script()
    endpoint = Endpoint(link)
    asked = endpoint.ask_time()
    assert asked > 0
    assert [item.message for item in Receiver().feed(link.sent)] == [TimeSync(asked, 0)]


def test_what_was_said_is_taken_out_and_samples_stay() -> None:
    endpoint = Endpoint(Script(board_frames()[3]))
    assert endpoint.said() == []
    endpoint.keep([other(1), row(5), other(2), row(6)])
    assert endpoint.said() == [RegisterRead(1), RegisterRead(2)]
    assert endpoint.said() == []
    assert [found[:2] for found in endpoint.receive_rows(0.0)] == [(5, 5), (6, 6)]


def test_without_samples_among_what_was_kept_new_ones_are_received() -> None:
    first, newer, _, _ = board_frames()
    endpoint = Endpoint(Script(first, newer))
    endpoint.poll(0.0)
    endpoint.keep([other(1)])
    assert [found[0] for found in endpoint.receive_rows(0.0)] == [5]
    endpoint.keep([row(7)])
    endpoint.keep([other(2)])  # a sample that was kept is not forgotten over it
    assert [found[0] for found in endpoint.receive_rows(0.0)] == [7]
    assert [item.message for item in endpoint.poll(0.0)] == [RegisterRead(1), RegisterRead(2)]


def test_what_is_kept_is_there_at_once_and_nothing_is_waited_for() -> None:
    link = Script()
    waits: list[float | None] = []
    link.receive = lambda timeout_s: waits.append(timeout_s) or b""
    endpoint = Endpoint(link)
    endpoint.keep([other(1)])
    assert len(endpoint.poll(3.0)) == 1
    assert endpoint.poll(3.0) == []
    assert waits == [0.0, 3.0]


def test_a_header_has_the_newest_tick_heard_unless_another_is_given() -> None:
    link = Script(board_frames()[0])
    endpoint = Endpoint(link)
    endpoint.poll(0.0)
    endpoint.send(Arm())
    endpoint.send(Arm(), 0)
    endpoint.send(Arm(), 77)
    assert [item.tick for item in Receiver().feed(link.sent)] == [5, 0, 77]


def test_a_stamp_of_the_kernel_goes_before_the_own_clock() -> None:
    link = Script(board_frames()[0], board_frames()[1])
    endpoint = Endpoint(link)
    link.arrived_ns = 12345
    endpoint.poll(0.0)
    assert endpoint.received_ns == 12345


@pytest.mark.parametrize(("number", "page"), [(REPEAT_WINDOW, 256), (REPEAT_RUN, 4)])
def test_numbers_of_the_page(number: int, page: int) -> None:
    """docs/wire.md, Frames and Gain mode."""
    assert number == page
