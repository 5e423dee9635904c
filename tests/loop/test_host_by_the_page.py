"""What docs/wire.md asks of a host, each held against the real host and a board that does as it is told here.

Written from the page's sentences, which stand above each check.
"""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.loop.request import RunRequest
from hil.loop.run import run
from hil.loop.stopping import bring_to_safe
from hil.progress import Progress
from hil.wire import client
from hil.wire.codec import pack, type_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.messages import (
    Arm,
    DriveForce,
    Hello,
    Message,
    Nack,
    NackReason,
    RegisterRead,
    RegisterValue,
    RegisterWrite,
    Safe,
    SafeReason,
    Status,
    TimeSync,
)
from hil.wire.sense import Sense
from hil.wire.serial_format import SERIAL
from hil.wire.spec import SPEC
from hil.wire.stream import Received
from tests.loop import gyro
from tests.loop.misbehaving import Board, served
from tests.loop.on_a_pty import Far, arrived, connected, rows, status

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


@pytest.fixture
def ends() -> Iterator[tuple[Endpoint, Far]]:
    with connected() as both:
        yield both


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


def test_headers_carry_the_newest_tick_and_in_lockstep_nobody_asks_the_time(board: Listens) -> None:
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


# -- 8: "A request that stays unanswered is sent again, with a number of its own"


def test_a_request_is_repeated_with_a_number_of_its_own(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    far.answer = lambda message: [RegisterValue(SESSION, 5.0)] if far.count(RegisterRead) == 3 else []
    assert client.read_register(host, "SESSION", 4.0) == 5.0
    assert far.count(RegisterRead) == 3
    assert (far.rx.lost, far.rx.repeated) == (0, 0)


# -- 9: "A number up to 256 behind … is a repetition: counted and dropped"; 4 that follow each other move the count back


def test_repetitions_are_dropped_until_four_follow_each_other(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    far.tx.seq = 100
    far.say(status(tick=1))
    assert len(arrived(host, 1)) == 1
    far.tx.seq = 20
    far.say(status(tick=2), status(tick=3), status(tick=4), status(tick=5))
    (taken,) = arrived(host, 1)
    assert isinstance(taken.message, Status)
    assert taken.message.tick == 5
    assert host.rx.repeated == 3
    far.say(status(tick=6))
    assert len(arrived(host, 1)) == 1
    assert host.rx.lost == 0


# -- 10: "SENSE is believed only if its payload has exactly the n rows it says": counted, no row used, tick not believed


@pytest.mark.parametrize(("n", "width"), [(0, 2), (2, 2), (1, 4), (1, 3), (65535, 2)])
def test_sense_that_contradicts_itself_is_not_believed(ends: tuple[Endpoint, Far], n: int, width: int) -> None:
    host, far = ends
    payload = bytearray(pack(rows((3, 4))))
    payload[:3] = n.to_bytes(2, "little") + bytes((width,))
    data, spent = SERIAL.encode(type_of(Sense), far.tx.seq, 1_000_000, bytes(payload))
    far.tx.seq += spent
    far.say_bytes(data)
    far.say(rows((3, 4)), tick=7)
    ((tick, *_),) = [row for row in _rows(host) if row]
    assert tick == 7
    assert (host.rx.undecodable, host.rx.lost) == (1, 0)


def _rows(host: Endpoint) -> list[tuple[int, ...]]:
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        if found := host.receive_rows(0.1):
            return [tuple(row) for row in found]
    return []


# -- 11: "NACK to HELLO | refused, by the reason, once the time for an answer is over; not called silence"


def test_a_nack_to_hello_is_told_once_the_time_is_over(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    far.answer = lambda message: [Nack(type_of(Hello), 0, NackReason.BAD_LENGTH)]
    begin = time.monotonic()
    with pytest.raises(ProtocolError, match="refused HELLO: BAD_LENGTH"):
        client.connect(host, 0.6)
    assert time.monotonic() - begin >= 0.5
    assert far.count(Hello) > 1


# -- 12: "STATUS of SAFE with NONE, or a reason that is not on this page | … no answer to a SAFE that latches"


@pytest.mark.parametrize("reason", [SafeReason.NONE, 77])
def test_no_reason_is_no_answer_to_a_safe_that_latches(ends: tuple[Endpoint, Far], reason: int) -> None:
    host, far = ends
    far.answer = lambda message: [status(reason=reason)] if isinstance(message, Safe) else []
    found = bring_to_safe(host, SafeReason.HOST_REQUEST, 0.5, rate_Hz=400.0)
    assert not found.confirmed
    assert far.count(Safe) == 8


# -- 13: "STATUS_BRIEF | passed over on CAN, an unknown type elsewhere": counted and dropped


def test_an_unknown_type_is_counted_and_dropped(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    for type_ in (0x33, 0x7F):
        data, spent = SERIAL.encode(type_, far.tx.seq, 5_000, bytes(8))
        far.tx.seq += spent
        far.say_bytes(data)
    far.say(status(tick=9), tick=9)
    (taken,) = arrived(host, 1)
    assert taken.tick == 9
    assert (host.rx.undecodable, host.rx.lost, host.rx.tick) == (2, 0, 9)
