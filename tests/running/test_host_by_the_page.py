"""What docs/wire.md asks of a host, each held against the real host and a board that does as it is told here.

Written from the page's sentences, which stand above each check.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.progress import Progress
from hil.running.request import RunRequest
from hil.running.run import run
from hil.wire.messages import (
    Arm,
    DriveForce,
    Hello,
    Message,
    RegisterRead,
    RegisterWrite,
    Safe,
    TimeSync,
)
from hil.wire.spec import SPEC
from hil.wire.stream import Received
from tests.running import gyro
from tests.running.misbehaving import Board, served

SESSION = SPEC.registers["SESSION"].id


class Listens(Board):
    """A board that behaves, and keeps every frame it hears with its header, and its own tick then."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[tuple[Received, int]] = []

    def answer(self, item: Received) -> list[Message]:
        self.heard.append((item, self.tick))
        return super().answer(item)

    def of(self, kind: type) -> list[tuple[Received, int]]:
        return [(item, tick) for item, tick in self.heard if isinstance(item.message, kind)]


def unwatched(_: Progress) -> None:
    """Nobody looks on."""


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Listens]:
    """After a whole run in lockstep."""
    out: Path = tmp_path_factory.mktemp("by-the-page")
    declared = gyro.unhurried_bench(1.5, "lockstep", link={"timeout_s": 5.0, "watchdog_s": 0.5})
    with served(Listens()) as found:
        run(RunRequest(declared, found.url), out, progress=unwatched, report=False)
        yield found


# -- 1: "HELLO comes first"; it carries the sender's protocol and hash


def test_hello_comes_first(board: Listens) -> None:
    first = board.heard[0][0]
    assert first.message == Hello(SPEC.protocol, SPEC.hash)
    assert first.seq == 0  # "from 0"


# -- 2: "Every frame takes the next one, whatever its type, but SAFE, which shows the next one and leaves it"


def test_numbers_follow_each_other_and_safe_takes_none(board: Listens) -> None:
    expected = 0
    for item, _ in board.heard:
        assert item.seq == expected, item
        expected = (expected + (not isinstance(item.message, Safe))) & 0xFFFF
    assert board.of(Safe)
    assert board.heard[-1][0].seq > board.of(Safe)[0][0].seq - 1
    assert board.rx.lost == board.rx.repeated == 0


# -- 3: "Host: the newest board tick it knows", in every header; "In lockstep … nobody asks" for the time


def test_headers_carry_the_newest_tick(board: Listens) -> None:
    streaming = [(item.tick, tick) for item, tick in board.of(DriveForce)[1:-1]]
    assert streaming
    assert all(told == tick for told, tick in streaming)
    assert not board.of(TimeSync)


# -- 4: "The drive computed from row m first acts on the interval that begins at m + L: that is its effective tick"


def test_each_row_is_answered_for_the_tick_a_latency_later(board: Listens) -> None:
    drives = [(item.message.effective_tick, tick) for item, tick in board.of(DriveForce) if board.safes]  # type: ignore[attr-defined]
    answers = drives[:-1]  # the last is the one that a board in SAFE has to refuse
    assert [effective for effective, _ in answers] == [tick + board.identity.latency_ticks for _, tick in answers]
    assert [tick for _, tick in answers] == list(range(len(answers)))


# -- 5: "Drive codes use the range ± (2^(b − 1) − 1) only"; DRIVE_LIMIT is written, and kept to


def test_codes_are_within_the_converter_and_the_limit(board: Listens) -> None:
    written = {item.message.register: item.message.value for item, _ in board.of(RegisterWrite)}
    most = min(written[SPEC.registers["DRIVE_LIMIT"].id], 2 ** (board.identity.drive_bits - 1) - 1)
    codes = [abs(code) for item, _ in board.of(DriveForce) for code in (item.message.ux, item.message.uy)]
    assert 0 < max(codes) <= most


# -- 6: "The host writes SESSION before ARM"; a number of its own, which is not that of a board that has just started


def test_session_is_written_before_arm_and_read_back(board: Listens) -> None:
    order = [item.message for item, _ in board.heard]
    armed = next(k for k, message in enumerate(order) if isinstance(message, Arm))
    before = [m for m in order[:armed] if isinstance(m, RegisterWrite) and m.register == SESSION]
    assert [m.value != 0 for m in before] == [True]
    assert RegisterRead(SESSION) in order[:armed]
    assert RegisterRead(SESSION) in order[armed:]


# -- 7: registers hold what their ranges allow, and those that are not live are written before ARM


def test_what_is_written_is_in_range_and_in_its_state(board: Listens) -> None:
    registers = {register.id: register for register in SPEC.registers.values()}
    armed = board.heard.index(board.of(Arm)[0])
    safe = board.heard.index(board.of(Safe)[0])
    for k, (item, _) in enumerate(board.heard):
        if isinstance(item.message, RegisterWrite):
            register = registers[item.message.register]
            assert register.accepts(item.message.value)
            assert register.live or not armed < k < safe
    modes = {item.message.register for item, _ in board.of(RegisterWrite)}
    assert {SPEC.registers[name].id for name in ("CLOCK_MODE", "LOOP_MODE", "BLOCK", "WATCHDOG_TICKS")} <= modes
