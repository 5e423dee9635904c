"""The board at a link, asked by pytest: `hil.testing.acceptance` names the link and collects what is answered."""

import os

from hil.testing.board_rules.conformance import Conformance
from hil.testing.board_rules.served import Board

LINK = "HIL_ACCEPT_LINK"


class TestBoard(Conformance):
    """Every rule, of the board that is there."""

    @property
    def alone(self) -> bool:  # type: ignore[override]
        """Of a board in this process."""
        return os.environ[LINK].startswith("inproc:")

    @classmethod
    def start(cls) -> Board:
        """It serves already."""
        return Board(url=os.environ[LINK])
