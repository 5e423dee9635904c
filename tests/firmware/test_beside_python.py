"""The C board beside the Python board, two programs from one spec: the same conversation, the same answers.

Both are told the same random things in lockstep. All they say is compared, headers included, but for who they are and
the sense codes, which come from different masses. In gain mode the matrices are zero for the same reason: bias,
dither, limits, and when a matrix acts, is what is compared then.
"""

import ctypes
import random
from collections import Counter
from typing import Literal

import numpy as np
import pytest

from device_emulator.board import Board
from device_emulator.device import Device
from hil.wire.can_format import CanFormat
from hil.wire.frame_format import BOARD, HOST
from hil.wire.messages import (
    Arm,
    ClockMode,
    DriveForce,
    DriveGains,
    FieldRead,
    Hello,
    Identity,
    LoopMode,
    Message,
    RegisterRead,
    RegisterWrite,
    Safe,
    TimeSync,
)
from hil.wire.sense import Sense
from hil.wire.serial_format import SERIAL
from hil.wire.spec import SPEC
from hil.wire.stream import Received, Receiver, Transmitter
from tests.emulator.gyro import scenario

from .c_board import CBoard

pytestmark = pytest.mark.slow

TURNS = 2000
AHEAD = (-3, -1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 3, 5, 15, 60)  # of the last row
VALUES = (0, 1, 2, 3, 100, 32768, 8388607, 1e9, -1, 0.5, float("nan"))
FIXED = ("CLOCK_MODE", "LOOP_MODE", "WATCHDOG_TICKS")  # what the conversation is about


def drive(chance: random.Random, effective_tick: int) -> Message:
    """A drive or a matrix; now and then what the other mode wants, or what nobody wants."""
    if chance.random() < 0.5:
        codes = chance.choice((0, 1, -2, 99, -32768, 2**31 - 1)), chance.randrange(-40000, 40000)
        return DriveForce(*codes, effective_tick)
    bias = chance.choice((0.0, 1.25, -3e4, 4e4, 1e30, float("inf"))), chance.randrange(-30000, 30000) + 0.25
    gain = (0.0,) * 7 + (chance.choice((0.0,) * 9 + (float("nan"),)),)
    return DriveGains(chance.choice((0, 1, 7, 255)), gain, bias, effective_tick)


def remark(chance: random.Random, tick: int) -> Message:
    """Something a host might say when the last row it heard was that of `tick`: drives, mostly."""
    turn = chance.random()
    register = chance.choice(list(SPEC.registers.values()))
    if turn < 0.7:
        return drive(chance, (tick + chance.choice(AHEAD)) & 0xFFFFFFFF)
    if turn < 0.8:
        return Arm() if chance.random() < 0.5 else Hello(SPEC.protocol, SPEC.hash)
    if turn < 0.9 and register.name not in FIXED:
        few = {"BLOCK": (0, 1, 1, 2, 3, 0.5)}
        few |= {name: (0.0, 0.0, 0.5, -0.5, 0.9, 1e9) for name in SPEC.registers if name.startswith("FILTER_A")}
        return RegisterWrite(register.id, chance.choice(few.get(register.name, VALUES)))
    return chance.choice(
        (
            Safe(chance.choice((0, 1, 3, 5, 5, 5, 5, 6, 200))),
            RegisterRead(register.id),
            RegisterRead(0x7000),
            FieldRead(chance.randrange(len(SPEC.table) + 5)),
            TimeSync(5, 0),
            Hello(SPEC.protocol, SPEC.hash ^ (chance.random() < 0.2)),
            Sense(np.zeros((1, 4), np.int32), 2, 0),
        )
    )


def faulty(chance: random.Random) -> bool | None:
    """Whether its protection trips now, or its fault is gone; mostly neither."""
    turn = chance.random()
    return True if turn < 0.01 else False if turn < 0.1 else None


def comparable(received: Received) -> tuple[object, ...]:
    """What both must say alike."""
    message = received.message
    if isinstance(message, Identity):
        return received.tick, received.seq, message.protocol, message.spec_hash, message.capabilities
    if isinstance(message, Sense):
        codes = message.codes[:, 2:].tolist()
        return received.tick, received.seq, codes, message.width, message.flags, message.matrix_id
    return tuple(received)


@pytest.mark.parametrize("kind", ["serial", "can"])
@pytest.mark.parametrize("latency", [0, 1, 3])
@pytest.mark.parametrize("mode", list(LoopMode))
def test_the_same_conversation_gets_the_same_answers(
    library: ctypes.CDLL, mode: LoopMode, latency: int, kind: Literal["serial", "can"]
) -> None:
    host, form = (SERIAL, SERIAL) if kind == "serial" else (CanFormat(2, HOST), CanFormat(2, BOARD))
    chance = random.Random(100 * latency + 10 * mode + len(kind))
    what = scenario({"sense": {"adc_bits": 16}, "drive": {"dac_bits": 16, "latency_samples": latency}})
    python = Board(what, Device(what), (ClockMode.LOCKSTEP, ClockMode.PACED), form)
    c = CBoard(library, kind, node=2, latency=latency)
    boards = [(python, Receiver(host)), (c, Receiver(host))]
    opening = [
        Hello(SPEC.protocol, SPEC.hash),
        RegisterWrite(SPEC.registers["CLOCK_MODE"].id, ClockMode.LOCKSTEP),
        RegisterWrite(SPEC.registers["LOOP_MODE"].id, mode),
        RegisterWrite(SPEC.registers["WATCHDOG_TICKS"].id, 8000),
    ]
    tx, tick = Transmitter(host), 0
    heard: Counter[str] = Counter()
    for turn in range(TURNS):
        said = opening[turn] if turn < len(opening) else remark(chance, tick)
        if turn >= len(opening) and chance.random() < 0.02:
            tx.seq = (tx.seq + chance.choice((5, -1, -2, -256, -257, -300))) & 0xFFFF
        fault = faulty(chance)
        if fault is not None:
            c.fault(fault)
            assert boards[0][1].feed(python.fault(fault)) == boards[1][1].feed(c.exchange(b""))
        data = tx.encode(said, tick)
        theirs, ours = ([comparable(item) for item in rx.feed(board.exchange(data))] for board, rx in boards)
        assert ours == theirs, (turn, said)
        tick = max([tick, *(item[0] for item in theirs if isinstance(item[0], int))])
        heard.update(type(item[2]).__name__ for item in theirs)
    assert {"Status", "Nack", "RegisterValue", "TimeSync", "FieldValue"} <= heard.keys()
    assert tick > TURNS // 20
