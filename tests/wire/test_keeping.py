"""What an endpoint keeps for a later call, and of how much it forgets the oldest."""

import numpy as np

from hil.wire.endpoint import Endpoint
from hil.wire.messages import Arm, RegisterRead, TimeSync
from hil.wire.sense import Sense
from hil.wire.stream import Received, Receiver
from tests.wire.test_endpoint import Script, board_frames


def row(tick: int) -> Received:
    return Received(tick, 0, Sense(np.array([[tick, 2, 3, 4]], np.int32), 2, 1))


def other(number: int) -> Received:
    return Received(0, 0, RegisterRead(number))


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


def test_a_header_has_the_newest_tick_heard_unless_another_is_given() -> None:
    link = Script(board_frames()[0])
    endpoint = Endpoint(link)
    endpoint.poll(0.0)
    endpoint.send(Arm())
    endpoint.send(Arm(), 0)
    endpoint.send(Arm(), 77)
    assert [item.tick for item in Receiver().feed(link.sent)] == [5, 0, 77]
