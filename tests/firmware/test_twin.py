"""The C board beside the Python board, two programs from one spec: the same conversation, the same answers.

Both are told the same random things in lockstep. All they say is compared, headers included, but for who they are and
the sense codes, which come from different masses.
"""

import random
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from device_emulator.board import Board
from device_emulator.device import Device
from hil.wire.endpoint import Endpoint
from hil.wire.links import open_link
from hil.wire.messages import (
    Arm,
    ClockMode,
    DriveForce,
    FieldRead,
    Hello,
    Identity,
    Message,
    RegisterRead,
    RegisterWrite,
    Safe,
    TimeSync,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from hil.wire.stream import Received, Receiver, Transmitter
from tests.emulator.gyro import scenario

from .process import PATIENCE_S, pty_board

TURNS = 2000
AHEAD = (-3, -1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 3, 5, 15)  # of the last row; the C board keeps 16 drives
VALUES = (0, 1, 2, 3, 100, 32768, 8388607, 1e9, -1, 0.5, float("nan"))
END = RegisterRead(0x7FFF)
"""There is none of that number: the refusal tells that the board has said all it wanted to say before."""


def remark(chance: random.Random, tick: int) -> Message:
    """Something a host might say when the last row it heard was that of `tick`: drives, mostly."""
    turn = chance.random()
    register = chance.choice(list(SPEC.registers.values()))
    if turn < 0.7:
        codes = chance.choice((0, 1, -2, 99, -32768, 2**31 - 1)), chance.randrange(-40000, 40000)
        return DriveForce(*codes, (tick + chance.choice(AHEAD)) & 0xFFFFFFFF)
    if turn < 0.8:
        return Arm()
    if turn < 0.9 and register.name not in ("CLOCK_MODE", "LOOP_MODE", "WATCHDOG_TICKS"):
        return RegisterWrite(register.id, chance.choice(VALUES if register.name != "BLOCK" else (0, 1, 1, 2, 3, 0.5)))
    return chance.choice(
        (
            Safe(chance.choice((0, 1, 3, 6, 200))),
            RegisterRead(register.id),
            RegisterRead(0x7000),
            FieldRead(chance.randrange(len(SPEC.table) + 5)),
            TimeSync(5, 0),
            Hello(SPEC.protocol, SPEC.hash ^ (chance.random() < 0.2)),
            Sense(np.zeros((1, 4), np.int32), 2, 0),
        )
    )


def comparable(received: Received) -> tuple[object, ...]:
    """What both must say alike."""
    message = received.message
    if isinstance(message, Identity):
        return received.tick, received.seq, message.protocol, message.spec_hash
    if isinstance(message, Sense):
        return received.tick, received.seq, message.codes[:, 2:].tolist(), message.width, message.flags
    return tuple(received)


def python_board() -> Callable[[bytes], list[Received]]:
    """The Python board, in this process."""
    what, rx = scenario({"sense": {"adc_bits": 16}, "drive": {"dac_bits": 16}}), Receiver()
    board = Board(what, Device(what), (ClockMode.LOCKSTEP,))
    return lambda data: rx.feed(board.exchange(data))


def hear(endpoint: Endpoint, enough: int) -> list[Received]:
    """What the C board says, until it is enough."""
    heard: list[Received] = []
    while len(heard) < enough:
        items = endpoint.poll(PATIENCE_S)
        assert items, f"silence after {heard}"
        heard += items
    return heard


@pytest.mark.parametrize("seed", range(4))
def test_the_same_conversation_gets_the_same_answers(built: Path, seed: int) -> None:
    chance = random.Random(seed)
    answers = python_board()
    tx = Transmitter()
    tick = 0
    opening = [
        Hello(SPEC.protocol, SPEC.hash),
        RegisterWrite(SPEC.registers["CLOCK_MODE"].id, ClockMode.LOCKSTEP),
        RegisterWrite(SPEC.registers["WATCHDOG_TICKS"].id, 1e6),
    ]
    heard: Counter[str] = Counter()
    with pty_board(built) as (_, url), closing(Endpoint(open_link(url))) as endpoint:
        for turn in range(TURNS):
            said = opening[turn] if turn < len(opening) else remark(chance, tick)
            if chance.random() < 0.02:
                tx.seq = (tx.seq + chance.choice((5, -1, -300))) & 0xFFFF
            for message in (said, END):
                data = tx.encode(message, tick)
                theirs = [comparable(item) for item in answers(data)]
                endpoint.link.send(data)
                assert [comparable(item) for item in hear(endpoint, len(theirs))] == theirs, (turn, message)
                tick = max([tick, *(item[0] for item in theirs if isinstance(item[0], int))])
                heard.update(type(item[2]).__name__ for item in theirs)
    assert {"Status", "Nack", "RegisterValue", "TimeSync", "FieldValue"} <= heard.keys()
    assert tick > TURNS // 10
