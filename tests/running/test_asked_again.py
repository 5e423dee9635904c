"""A board that has said SAFE is asked once more: one that is slow on a busy machine is not accused of silence."""

import time
from collections.abc import Sequence

import pytest

from hil.running.safety import asked_again
from hil.running.safety.asked_again import Asked, ask_again, zero_drive
from hil.wire.codec import type_of
from hil.wire.messages import DriveForce, Message, Nack, NackReason, RegisterRead, RegisterValue
from tests.running.on_a_pty import connected

PATIENCE_S, LONGEST_S = 0.2, 1.2


def asked(monkeypatch: pytest.MonkeyPatch, delay_s: float, *, refuses: bool = True) -> Asked:
    """What comes of asking a board that answers so much later, and that refuses drives at once or does not."""
    monkeypatch.setattr(asked_again, "_PATIENCE_S", PATIENCE_S)
    monkeypatch.setattr(asked_again, "_LONGEST_S", LONGEST_S)
    with connected() as (host, far):

        def answer(message: Message) -> Sequence[Message]:
            if isinstance(message, DriveForce) and refuses:
                return [Nack(type_of(DriveForce), len(far.heard) - 1, NackReason.BAD_STATE)]
            if isinstance(message, RegisterRead):
                time.sleep(delay_s)
                return [RegisterValue(message.register, 200.0)]
            return []

        far.answer = answer
        return ask_again(host, zero_drive(DriveForce, 7), {"WATCHDOG_TICKS": 200.0}, 0.1)


@pytest.mark.parametrize("delay_s", [0.0, 2.5 * PATIENCE_S])
def test_a_board_that_refused_a_drive_may_take_its_time(monkeypatch: pytest.MonkeyPatch, delay_s: float) -> None:
    assert asked(monkeypatch, delay_s) == Asked(refused=True)


def test_one_that_never_answers_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    begin = time.monotonic()
    assert asked(monkeypatch, 2.0 * LONGEST_S).odd == ["it does not answer in SAFE, asked for WATCHDOG_TICKS"]
    assert time.monotonic() - begin >= LONGEST_S


def test_one_that_does_not_refuse_is_not_waited_for_as_long(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(monkeypatch, 2.5 * PATIENCE_S, refuses=False)
    assert not found.refused
    assert found.odd[-1] == "it does not answer in SAFE, asked for WATCHDOG_TICKS"
