"""The C board holds what every board holds; on CAN that is tests/vcan."""

from pathlib import Path

import pytest

from tests.wire.conformance import Board, Conformance

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
