"""The state table of docs/safety.md, cell by cell, on the C board and on the emulated one.

A board is brought into the situation, the event happens, and what it says and where it is then is compared with the
cell. Whether a stop stands and whether a fault is there is asked as a host could ask it.
"""

import ctypes
from collections.abc import Callable

import pytest

from device_emulator.board import Board
from device_emulator.device import Device
from hil.wire.messages import (
    Arm,
    ClockMode,
    DriveForce,
    DriveGains,
    Hello,
    Message,
    Nack,
    NackReason,
    RegisterWrite,
    Safe,
    SafeReason,
    State,
    Status,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter
from tests.emulator.gyro import scenario

from .c_board import CBoard

HELLO, HELLO_OTHER = Hello(SPEC.protocol, SPEC.hash), Hello(SPEC.protocol, SPEC.hash ^ 1)
STATES = SPEC.states
WATCHDOG = 5
CANNOT_BE = {("BOOT", "ARM"), ("ARMED", "ARM_UNGREETED"), ("RUNNING", "ARM_UNGREETED")}
"""HELLO decides between the two kinds of ARM, and it takes a board out of these situations."""

REASON = {
    "SAFE": SafeReason.LINK_LOST,
    "SAFE_LATCHED": SafeReason.RESIDUAL,
    "SAFE_FAULT": SafeReason.FAULT,
    "SAFE_FAULT_LATCHED": SafeReason.FAULT,
}
"""What STATUS says in the situations as `Bench.bring` brings them about."""


class Bench:
    """A board on wall time whose ticks the test makes, and its host."""

    def __init__(self, board: Board | CBoard) -> None:
        self.board = board
        self.tx, self.rx = Transmitter(), Receiver()

    def say(self, message: Message) -> list[Message]:
        """What the board says to a message, samples left out."""
        return self.heard(self.board.exchange(self.tx.encode(message, 0)))

    def heard(self, data: bytes) -> list[Message]:
        return [item.message for item in self.rx.feed(data) if not isinstance(item.message, Sense)]

    def pass_ticks(self, ticks: int) -> list[Message]:
        heard = []
        for _ in range(ticks):
            if isinstance(self.board, CBoard):
                self.board.tick()
                heard += self.heard(self.board.exchange(b""))
            else:
                heard += self.heard(self.board.block() if self.board.streaming else self.board.coast(1))
        return heard

    def fault(self, present: bool) -> list[Message]:
        told = self.board.fault(present)
        return self.heard(told or b"") + self.heard(self.board.exchange(b""))

    def hang_up(self) -> list[Message]:
        self.board.hang_up()
        return self.heard(self.board.exchange(b""))

    def bring(self, situation: str) -> None:
        """Into a situation, by the page's own words."""
        if situation == "BOOT":
            return
        self.say(HELLO)
        self.say(RegisterWrite(SPEC.registers["WATCHDOG_TICKS"].id, WATCHDOG))
        if situation in ("ARMED", "RUNNING"):
            self.say(Arm())
            self.pass_ticks(2)
        if situation == "RUNNING":
            self.say(DriveForce(9, 9, 2))
        if situation == "SAFE":
            self.say(Safe(SafeReason.LINK_LOST))
        if "FAULT" in situation:
            self.fault(True)
        if situation.endswith("LATCHED"):
            self.say(Safe(SafeReason.RESIDUAL))

    def happen(self, event: str, situation: str) -> list[Message]:
        """Let an event happen; what the board says."""
        messages: dict[str, Message] = {
            "HELLO": HELLO,
            "HELLO_OTHER": HELLO_OTHER,
            "ARM": Arm(),
            "SAFE_LATCHING": Safe(SafeReason.INTERRUPTED),
            "SAFE_PASSING": Safe(SafeReason.LINK_LOST),
            "DRIVE": DriveForce(3, 3, 3),
            "DRIVE_LATE": DriveForce(3, 3, 0xFFFFFFF0),
            "DRIVE_OTHER": DriveGains(1, (0.0,) * 8, (0.0, 0.0), 3),
            "WRITE": RegisterWrite(SPEC.registers["BLOCK"].id, 1),
            "WRITE_LIVE": RegisterWrite(SPEC.registers["STATUS_EVERY"].id, 0),
        }
        if event in messages:
            return self.say(messages[event])
        if event == "ARM_UNGREETED":
            if situation != "BOOT":
                self.say(HELLO_OTHER)
            return self.say(Arm())
        own: dict[str, Callable[[], list[Message]]] = {
            "WATCHDOG": lambda: self.pass_ticks(2 * WATCHDOG),
            "LINK_LOST": self.hang_up,
            "FAULT": lambda: self.fault(True),
            "FAULT_GONE": lambda: self.fault(False),
        }
        return own[event]()

    def reason(self) -> int:
        """Of a board in SAFE: why."""
        (status,) = self.say(Safe(SafeReason.LINK_LOST))
        assert isinstance(status, Status)
        return status.reason

    def latched(self) -> bool:
        """Whether a stop stands: then another one does not change the reason, the fault being gone."""
        before = self.reason()
        self.fault(False)
        other = SafeReason.HOST_REQUEST if before != SafeReason.HOST_REQUEST else SafeReason.RESIDUAL
        self.say(Safe(other))
        return self.reason() == before

    def faulty(self) -> bool:
        """Whether a fault is there: then HELLO alone does not make it possible to arm."""
        self.say(HELLO)
        (answer,) = self.say(Arm())
        return isinstance(answer, Nack) and answer.reason == NackReason.LATCHED


@pytest.fixture(params=["emulator", pytest.param("C", marks=pytest.mark.slow)])
def make(request: pytest.FixtureRequest) -> Callable[[], Bench]:
    """Makes boards that were just switched on."""
    if request.param == "C":
        library: ctypes.CDLL = request.getfixturevalue("library")
        return lambda: Bench(CBoard(library))
    what = scenario({"sense": {"adc_bits": 16}, "drive": {"dac_bits": 16}})
    return lambda: Bench(Board(what, Device(what), (ClockMode.PACED, ClockMode.LOCKSTEP)))


@pytest.mark.slow
@pytest.mark.parametrize(("situation", "event"), [pair for pair in STATES.table if pair not in CANNOT_BE])
def test_cell(make: Callable[[], Bench], situation: str, event: str) -> None:
    cell = STATES.table[situation, event]

    def brought() -> tuple[Bench, list[Message]]:
        bench = make()
        bench.bring(situation)
        assert bench.board.state == State[STATES.state[situation]]
        return bench, bench.happen(event, situation)

    bench, heard = brought()
    reason = {
        "": REASON.get(situation, SafeReason.NONE),
        "SENT": SafeReason.LINK_LOST if event == "SAFE_PASSING" else SafeReason.INTERRUPTED,
    }.get(cell.reason) or SafeReason[cell.reason or "NONE"]
    if cell.refusal:
        (answer,) = heard
        assert isinstance(answer, Nack)
        assert answer.reason == NackReason[cell.refusal]
    elif cell.answer:
        (answer,) = heard
        assert type(answer).__name__.upper() == cell.answer.replace("_", "")
        if isinstance(answer, Status):
            assert (answer.state, answer.reason) == (State[STATES.state[cell.next]], reason)
    else:
        assert heard == []
    assert bench.board.state == State[STATES.state[cell.next]]
    if STATES.state[cell.next] == "SAFE":
        assert bench.reason() == reason
        assert bench.latched() is cell.next.endswith("LATCHED")
        assert brought()[0].faulty() is ("FAULT" in cell.next)


STOPS = [(state, event) for (state, event), cell in STATES.table.items() if state in ("ARMED", "RUNNING")
         and STATES.state[cell.next] == "SAFE" and (state, event) not in CANNOT_BE]  # fmt: skip


@pytest.mark.parametrize(("state", "event"), STOPS)
def test_no_force_but_while_running(make: Callable[[], Bench], state: str, event: str) -> None:
    """Whatever stops it: the drive in force and those that wait are gone, also once it is armed again."""
    bench = make()
    bench.bring(state)
    if state == "RUNNING":
        bench.say(DriveForce(500, 500, 4))
        bench.say(DriveForce(600, 600, 40))
        bench.pass_ticks(4)
        bench.say(DriveForce(400, 400, 9))  # feeds the watchdog
    bench.happen(event, state)
    assert bench.board.state == State.SAFE
    if isinstance(bench.board, CBoard):  # what reaches its converters: within the interval, and at every tick after it
        assert bench.board.put[-1:] == [(0, 0)]
        assert {bench.board.tick() for _ in range(60)} == {(0, 0)}
    bench.fault(False)
    bench.say(HELLO)
    bench.say(Arm())
    assert bench.board.state == State.ARMED
    shown = set()
    for _ in range(60):
        if isinstance(bench.board, CBoard):
            bench.board.tick()
        data = bench.board.exchange(b"") if isinstance(bench.board, CBoard) else bench.board.block()
        for item in bench.rx.feed(data):
            if isinstance(item.message, Sense):
                shown |= set(map(tuple, item.message.codes[:, 2:].tolist()))
    assert shown == {(0, 0)}


@pytest.mark.slow
def test_the_board_in_c_runs_by_this_very_table(library: ctypes.CDLL) -> None:
    """In its memory: next situation, reason, answer, refusal of every cell."""
    reasons = {"": 0xFF, "SENT": 0xFE} | {name: int(value) for name, value in SafeReason.__members__.items()}
    order = list(STATES.situations)
    expected = []
    for cell in STATES.table.values():
        answer = SPEC.messages[cell.answer].type if cell.answer else 0
        refusal = NackReason[cell.refusal] if cell.refusal else 0
        expected += [order.index(cell.next), reasons[cell.reason], answer, int(refusal)]
    there = (ctypes.c_uint8 * len(expected)).in_dll(library, "hil_transitions")
    assert list(there) == expected
