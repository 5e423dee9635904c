"""The C board holds what every board holds; on CAN that is tests/vcan."""

from pathlib import Path

import pytest

from hil.testing.board_rules.conformance import Board, Conformance
from hil.testing.board_rules.rules import Rules
from hil.wire.endpoint import Endpoint

pytestmark = pytest.mark.slow


@pytest.mark.slow
class TestCBoardOnPty(Conformance):
    @pytest.fixture(scope="class", autouse=True)
    @classmethod
    def _program(cls, built: Path) -> None:
        cls.program = str(built / "pty_board")

    @classmethod
    def start(cls) -> Board:
        return Board([cls.program])

    @classmethod
    def start_faulty(cls, first_s: float, duration_s: float) -> Board:
        return Board([cls.program, "--fault", f"{first_s}:{duration_s}"])


def test_the_window_of_a_matrix_without_latency(built: Path) -> None:
    board = Board([str(built / "pty_board"), "--latency", "0"])
    try:
        host = Endpoint(board.open())
        Rules().test_the_window_of_a_matrix(host)
        host.close()
    finally:
        board.end()
