"""`hil identify --accept`: the rules of the wire asked of a board; the one that is not kept is named."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from device_emulator import board as emulator
from device_emulator.board import Board
from device_emulator.registers import Refused
from hil.boards.emulation import located
from hil.progress import untold
from hil.testing.acceptance import Accepted, accept
from hil.wire.messages import Arm, Capabilities, Identity, LoopMode, Message, NackReason, RegisterWrite, Safe, State
from hil.wire.spec import SPEC

pytestmark = pytest.mark.slow


def asked(folder: Path) -> Accepted:
    return accept(located("inproc:s-slow"), folder, untold)


def test_a_board_that_keeps_them_all_is_told_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTEST_ADDOPTS", "-k no_such_rule")  # of the user's own tests
    answers = asked(tmp_path)
    assert answers.good
    assert len(answers.kept) > 60
    assert answers.broken == {}
    assert answers.folder is not None
    page = (answers.folder / "accept.html").read_text(encoding="utf-8")
    assert "rules are kept" in page


def test_a_rule_that_is_not_kept_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A board whose stops do not latch."""
    arm = Board._arm

    def unlatched(board: Board, message: Arm) -> list[Message]:
        board._latched = False
        return arm(board, message)

    monkeypatch.setattr(Board, "_arm", unlatched)
    answers = asked(tmp_path)
    assert not answers.good
    assert any("latches until hello" in rule for rule in answers.broken)
    assert len(answers.broken) < 20
    assert all(re.match("expected .+, came .+", why) for why in answers.broken.values())
    assert "expected refusal(host, Arm()) is LATCHED, came none" in answers.broken.values()


def says_safe(board: Board, safe: Safe) -> list[Message]:
    return [board.status()._replace(state=State.SAFE, reason=safe.reason)]


@pytest.mark.parametrize(
    ("answer", "came"),
    [(says_safe, "RUNNING: it says SAFE and stays driven"), (lambda *_: [], "no answer to SAFE within 5 s")],
)
def test_a_board_that_does_not_go_safe_ends_it_at_once(
    answer: Callable[[Board, Safe], list[Message]], came: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Board, "_safe", answer)
    answers = asked(tmp_path)
    assert not answers.good
    assert came in answers.unsafe
    assert answers.as_json()["unsafe"] == answers.unsafe
    assert len(answers.broken) == 1
    assert answers.alarm.startswith("cut the supply of the board; expected ")
    assert answers.folder is not None
    assert "</strong> Cut the supply of the board; " in (answers.folder / "accept.html").read_text(encoding="utf-8")


def test_rules_of_a_loop_mode_that_the_board_lacks_are_not_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    identity, write = emulator._identity, Board._write

    def force_only(board: Board, request: RegisterWrite) -> list[Message]:
        if request.register == SPEC.registers["LOOP_MODE"].id and request.value == LoopMode.GAIN:
            raise Refused(NackReason.NOT_SUPPORTED)
        return write(board, request)

    def named(*given: Any) -> Identity:
        able = identity(*given)
        return able._replace(capabilities=able.capabilities & ~Capabilities.GAIN_MODE)

    monkeypatch.setattr(emulator, "_identity", named)
    monkeypatch.setattr(Board, "_write", force_only)
    answers = asked(tmp_path)
    assert answers.broken == {}
    assert list(answers.untried.values()).count("this board has no gain mode") == 6
