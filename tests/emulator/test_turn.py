"""The board's turn over samples, which is C, beside the rules of docs/wire.md written down once more in Python, and its
frames beside those of Python's own codec."""

import random
from typing import Any

import numpy as np
import pytest

from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.scenario import Scenario
from hil.wire.messages import Arm, ClockMode, DriveForce, Hello, Message, RegisterWrite, SenseFlags, State, Status
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter
from tests.emulator.gyro import scenario

TURNS = 600
WATCHDOG = 20
AHEAD = (-2, 0, 0, 0, 0, 0, 0, 0, 1, 2, 5, 70, 60_000, 70_000)  # of the first tick that is still open


class Rules:
    """A board that runs, in lockstep, and nothing else: which drive acts when, and what is counted."""

    def __init__(self, latency: int, block: int, limit: int, tick: int) -> None:
        self.latency, self.block, self.limit, self.tick = latency, block, limit, tick
        self.waiting: dict[int, tuple[int, int, bool]] = {}
        self.held = (0, 0, False)
        self.due: int | None = None  # next tick that needs a drive
        self.fed = tick
        self.counted = dict.fromkeys(("late", "held", "saturated", "watchdog_trips"), 0)

    def bounded(self, ux: int, uy: int, limited: bool = False) -> tuple[int, int, bool]:
        """A drive within the limit."""
        inside = [max(-self.limit, min(code, self.limit)) for code in (ux, uy)]
        return inside[0], inside[1], limited or inside != [ux, uy]

    def narrow(self, limit: int) -> None:
        """DRIVE_LIMIT, which holds at once."""
        self.limit = limit
        self.held = self.bounded(*self.held)
        self.waiting = {tick: self.bounded(*command) for tick, command in self.waiting.items()}

    def drive(self, ux: int, uy: int, tick: int) -> tuple[list[tuple[int, int]], int] | None:
        """Drives that the next block shows, and its flags; None where the board does not run yet."""
        opened = self.tick + (self.latency > 0)
        if not 0 <= tick - opened < 1 << 16:
            self.counted["late"] += 1
            if self.due is None:
                return None
        else:
            self.waiting[tick] = self.bounded(ux, uy)
            self.counted["saturated"] += self.waiting[tick][2]
            self.fed = self.tick
            self.due = tick if self.due is None else self.due
        shown, flags = [], 0
        for _ in range(self.block):
            came = self.tick in self.waiting
            self.held = self.waiting.pop(self.tick, self.held)
            if self.due is not None and self.tick - self.fed >= WATCHDOG:
                self.counted["watchdog_trips"] += 1
                self.held, self.waiting, self.due, self.fed = (0, 0, False), {}, None, 1 << 62
            elif self.tick == self.due:
                self.due += self.block
                self.counted["held"] += not came
                flags |= 0 if came else SenseFlags.HELD
            flags |= SenseFlags.SATURATED if self.held[2] else 0
            shown.append(self.held[:2])
            self.tick += 1
        return shown, flags


def said_by(what: Scenario, messages: list[Message], portion: int) -> tuple[bytes, Board]:
    """All that a board in lockstep says to a host whose bytes come so many at a time; 0: message by message."""
    board, tx = Board(what, Device(what), (ClockMode.LOCKSTEP,)), Transmitter()
    said = b""
    for message in messages:
        data = tx.encode(message, 0)
        step = portion or len(data)
        said += b"".join(board.exchange(data[k : k + step]) for k in range(0, len(data), step))
    return said, board


@pytest.mark.parametrize("wide", [False, True], ids=["narrow", "wide"])
@pytest.mark.parametrize("block", [1, 3])
@pytest.mark.parametrize("latency", [0, 1, 3])
def test_random_drives_act_by_the_rules(latency: int, block: int, wide: bool) -> None:
    chance = random.Random(100 * latency + 10 * block + wide)
    sizes: dict[str, Any] = {"adc_bits": 24} if wide else {"adc_bits": 16}
    what = scenario({"sense": sizes | {"noise_V": 1e-4}, "drive": {"latency_samples": latency, "dac_bits": 16}})
    writes = {"BLOCK": block, "WATCHDOG_TICKS": WATCHDOG, "STATUS_EVERY": 50}
    messages: list[Message] = [Hello(SPEC.protocol, SPEC.hash)]
    messages += [RegisterWrite(SPEC.registers[name].id, value) for name, value in writes.items()]
    messages.append(Arm())
    rules = Rules(latency, block, 32767, block - 1)
    expected: list[tuple[list[tuple[int, int]], int]] = [([(0, 0)] * block, 0)]
    trips = 0
    while len(messages) < TURNS:
        if chance.random() < 0.01:
            limit = chance.choice((100, 30_000, 32_767, 40_000))
            messages.append(RegisterWrite(SPEC.registers["DRIVE_LIMIT"].id, limit))
            rules.narrow(min(limit, 32_767))
            continue
        away = -5 if rules.due is not None and chance.random() < 0.004 else None  # then nothing in time until SAFE
        for _ in range(1 if away is None else WATCHDOG + 5):
            ahead = chance.choice(AHEAD) if away is None else away
            codes = chance.choice((0, -5, 40_000)), chance.randrange(-33_000, 33_000)
            tick = rules.tick + (latency > 0) + ahead
            messages.append(DriveForce(*codes, tick & 0xFFFFFFFF))
            shown = rules.drive(*codes, tick)
            if shown is not None:
                expected.append(shown)
            elif trips == rules.counted["watchdog_trips"]:  # ARMED: it goes on, and nothing is due
                expected.append(([(0, 0)] * block, 0))
                rules.tick += block
            if rules.counted["watchdog_trips"] > trips:
                trips += 1
                break
        if rules.fed == 1 << 62:
            break
    said, board = said_by(what, messages, 0)
    assert said == said_by(what, messages, 1)[0] == said_by(what, messages, 7)[0]

    rx, tx = Receiver(), Transmitter()
    found, sensed, encoded, statuses = [], [], b"", 0
    for received in rx.feed(said):
        message = received.message
        encoded += tx.encode(message, received.tick)
        if isinstance(message, Sense):
            flags = message.flags & (SenseFlags.HELD | SenseFlags.SATURATED)
            sensed.append(message.codes[:, :2])
            found.append(([(ux, uy) for _, _, ux, uy in message.codes.tolist()], flags))
        statuses += isinstance(message, Status)
    assert found == expected
    assert encoded == said
    assert statuses > len(found) * block // 50
    told = board.status()._asdict()
    assert {name: told[name] for name in rules.counted} == rules.counted
    assert (board.state is State.SAFE) == (trips > 0)
    drives = np.array([row for rows, _ in found for row in rows])
    np.testing.assert_array_equal(Device(what).rows(drives), np.vstack(sensed))
