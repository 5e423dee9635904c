"""The thread that holds a board outlives whatever it is asked."""

import queue
from typing import Any, cast

from hil.service.board.held_board import HeldBoard
from hil.wire.link_name import LinkName

PATIENCE_S = 10.0


def test_safe_is_answered_after_a_fault_in_what_was_asked() -> None:
    answers: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    board = HeldBoard(lambda _: None)
    try:
        board.connect(cast("LinkName", None), answers.put)  # what nobody foresaw
        assert "NoneType" in answers.get(timeout=PATIENCE_S)["refused"]
        board.safe(answers.put)
        assert answers.get(timeout=PATIENCE_S)["said"]["words"] == "no board is connected"
    finally:
        board.end()
