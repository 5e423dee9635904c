"""What is particular to the C board's links: CAN frames by the golden vectors, links without room, locks, memory."""

import ctypes
import json
import struct
from pathlib import Path
from typing import Any, Literal

import pytest

from hil.wire.can_format import HEAD, HOST, RECORD_SIZE, CanFormat
from hil.wire.messages import (
    Arm,
    ClockMode,
    DriveForce,
    FieldValue,
    Hello,
    Message,
    Nack,
    NackReason,
    RegisterRead,
    RegisterValue,
    RegisterWrite,
    Safe,
    SafeReason,
    State,
    Status,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from hil.wire.stream import Received, Receiver, Transmitter

from .c_board import CBoard

pytestmark = pytest.mark.slow

VECTORS = json.loads((Path(__file__).parents[1] / "wire" / "golden.json").read_text(encoding="utf-8"))
said_by_boards = [vector for vector in VECTORS["frames"] if SPEC.messages[vector["message"]].sender != "host"]


def record_of(frame: dict[str, Any]) -> bytes:
    """A CAN frame of the golden vectors, as a record."""
    data = bytes.fromhex(frame["data"])
    head = HEAD.pack(int(frame["id"], 16), len(data), 5 if frame["fd"] else 0)
    return (head + data).ljust(RECORD_SIZE, b"\0")


class Host:
    """Says messages to a board in this process, over either link."""

    def __init__(self, board: CBoard, kind: Literal["serial", "can"], node: int = 0) -> None:
        self.board = board
        self.tx, self.rx = (
            (Transmitter(), Receiver())
            if kind == "serial"
            else (Transmitter(CanFormat(node, HOST)), Receiver(CanFormat(node, HOST)))
        )
        self.say(Hello(SPEC.protocol, SPEC.hash))
        self.say(RegisterWrite(SPEC.registers["CLOCK_MODE"].id, ClockMode.LOCKSTEP))

    def say(self, message: Message) -> list[Message]:
        return [received.message for received in self.heard(self.tx.encode(message, 0))]

    def heard(self, data: bytes) -> list[Received]:
        return self.rx.feed(self.board.exchange(data))


@pytest.fixture(params=["serial", "can"])
def host(library: ctypes.CDLL, request: pytest.FixtureRequest) -> Host:
    return Host(CBoard(library, request.param), request.param)


@pytest.mark.parametrize("vector", said_by_boards, ids=lambda vector: vector["name"])
def test_can_frames_of_the_golden_vectors(library: ctypes.CDLL, vector: dict[str, Any]) -> None:
    nodes = {int(frame["id"], 16) >> 1 & 7 for frame in vector["can"]}
    board = CBoard(library, "can", node=nodes.pop())
    type_ = SPEC.messages[vector["message"]].type
    assert board.send(type_, vector["seq"], vector["tick"], bytes.fromhex(vector["payload"]))
    board_frames = [record_of(frame) for frame in vector["can"] if int(frame["id"], 16) & 1]
    assert not board_frames or board.said == b"".join(board_frames)
    assert board_frames or vector["message"] == "TIME_SYNC"  # whose vector is the host's


def test_long_messages_and_blocks_travel_in_parts(library: ctypes.CDLL) -> None:
    host = Host(CBoard(library, "can", node=3), "can", 3)
    for size in (55, 56, 57, 112, 300):
        assert host.board.send(SPEC.messages["FIELD_VALUE"].type, 77, 5, bytes(4) + b"a" * (size - 4))
        (item,) = Receiver(CanFormat(3, HOST)).feed(host.board.said)
        assert item == Received(5, 77, FieldValue(0, 0, "a" * (size - 4)))
        host.board.said = b""
    (answer,) = host.say(RegisterWrite(SPEC.registers["BLOCK"].id, 100))
    assert isinstance(answer, RegisterValue)
    heard = host.heard(host.tx.encode(Arm(), 0))
    blocks = [item for item in heard if isinstance(item.message, Sense)]
    assert [item.tick for item in blocks] == list(range(0, 100, 7))
    assert sum(len(item.message.codes) for item in blocks if isinstance(item.message, Sense)) == 100
    assert host.rx.lost == host.rx.repeated == 0


def test_a_link_without_room_drops_whole_blocks_and_tells(host: Host) -> None:
    host.say(RegisterWrite(SPEC.registers["BLOCK"].id, 30))
    host.say(RegisterWrite(SPEC.registers["CLOCK_MODE"].id, ClockMode.PACED))
    host.say(Arm())
    board = host.board
    for _ in range(4):  # nobody polls: two blocks fill both halves of the memory, two are dropped
        for _ in range(30):
            board.tick()
    board.poll()
    board.room = 3
    for _ in range(30):
        board.tick()
    board.poll()  # does not fit
    board.room = 1 << 20
    for _ in range(30):
        board.tick()
    heard = host.heard(b"")
    assert [item.tick - item.tick % 30 for item in heard] == [0] * (len(heard) // 2) + [150] * (len(heard) // 2)
    (status,) = host.say(Safe(SafeReason.HOST_REQUEST))
    assert isinstance(status, Status)
    assert status.dropped == 4
    per_block = 5 if len(heard) > 2 else 1
    assert host.rx.lost == 4 * per_block


def test_unasked_status_comes_at_multiples_whatever_happened_between(host: Host) -> None:
    host.say(RegisterWrite(SPEC.registers["CLOCK_MODE"].id, ClockMode.PACED))
    host.say(RegisterWrite(SPEC.registers["STATUS_EVERY"].id, 7))
    told = []
    for _ in range(2):
        host.say(Arm())
        for _ in range(20):
            host.board.tick()
            told += [item.message.tick for item in host.heard(b"") if isinstance(item.message, Status)]
        host.say(Safe(SafeReason.LINK_LOST))
        for _ in range(5):
            host.board.tick()
    assert told == [0, 7, 14, 28, 35, 42]


def test_more_drives_than_can_wait_are_refused(host: Host) -> None:
    host.say(RegisterWrite(SPEC.registers["CLOCK_MODE"].id, ClockMode.PACED))
    host.say(RegisterWrite(SPEC.registers["WATCHDOG_TICKS"].id, 8000))  # 2 s
    host.say(Arm())
    host.board.tick()
    host.heard(b"")
    for k in range(16):
        assert len(host.say(DriveForce(k, k, 7000 - k))) == (k == 0)  # STATUS at the first
    assert host.say(DriveForce(99, 99, 6990)) == []  # in place of another one
    (nack,) = host.say(DriveForce(5, 5, 7001))
    assert isinstance(nack, Nack)
    assert nack.reason == NackReason.OUT_OF_RANGE
    drives = [host.board.tick()[0] for _ in range(7002)]  # the first of them is that of tick 0
    expected = [7000 - tick for tick in range(6985, 7001)]
    expected[6990 - 6985] = 99
    assert drives[6985:7001] == expected
    assert drives[7001] == 0  # the one of tick 7000, held
    assert not any(drives[:6985])


def test_the_sample_interrupt_is_never_left_masked(host: Host) -> None:
    for message in (Arm(), RegisterRead(1), Safe(1)):
        host.say(message)
    assert not host.board.locked
    assert host.board.unlocked >= 3


def test_anybody_on_the_bus_may_stop_the_board(library: ctypes.CDLL) -> None:
    """`cansend can0 010#01`, and the same without a reason."""
    host = Host(CBoard(library, "can"), "can")
    for data, flags, reason in (
        (b"\3", 0, SafeReason.RESIDUAL),
        (b"", 0, SafeReason.HOST_REQUEST),
        (b"\5\0", 0, SafeReason.HOST_REQUEST),  # of a length that SAFE has not
        (b"\3" + bytes(7), 4, SafeReason.HOST_REQUEST),  # CAN FD
    ):
        host.say(Hello(SPEC.protocol, SPEC.hash))
        host.say(Arm())
        record = (HEAD.pack(0x010, len(data), flags) + data).ljust(RECORD_SIZE, b"\0")
        *_, last = host.heard(record)
        assert isinstance(last.message, Status)
        assert (last.message.state, last.message.reason) == (State.SAFE, reason)
    (status,) = host.say(Safe(1))
    assert isinstance(status, Status)
    assert status.lost_seq == 0


@pytest.mark.parametrize(
    ("identifier", "data", "bad"),
    [
        (0x012, b"\1", 0),  # another node's
        (0x011, b"\1", 0),  # a board's
        (0x330, bytes(8), 0),  # brief status, which hosts do not send
        (0x020, bytes(5), 1),  # ARM cut short
        (0x100, bytes(7), 1),  # no room for a header
        (0x100, bytes.fromhex("0000 00000000 39 00") + bytes(56), 1),  # more than fits
        (0x100, bytes.fromhex("0000 00000000 0c 00") + bytes(16), 1),  # not the shortest legal length
    ],
)
def test_can_frames_that_are_wrong_or_not_ours(library: ctypes.CDLL, identifier: int, data: bytes, bad: int) -> None:
    host = Host(CBoard(library, "can"), "can")
    assert host.heard((HEAD.pack(identifier, len(data), 4) + data).ljust(RECORD_SIZE, b"\0")) == []
    (status,) = host.say(Safe(1))
    assert isinstance(status, Status)
    assert status.bad_frames == bad


def test_a_message_of_several_parts_is_judged_whole(library: ctypes.CDLL) -> None:
    """No host sends one; a board says so once it has seen it all, and counts it when a part is missing."""
    host = Host(CBoard(library, "can"), "can")

    def parts(seq: int, size: int) -> list[bytes]:
        sizes = [min(56, size - at) for at in range(0, size + 1, 56)]
        heads = [struct.pack("<HIBB", seq, 0, part_size, k) for k, part_size in enumerate(sizes)]
        # Of 200 bytes the last part has 32: 40 with its header, which travel in 48.
        lengths = [64 if part_size == 56 else 48 for part_size in sizes]
        return [
            (HEAD.pack(0x440, length, 4) + head).ljust(RECORD_SIZE, b"\0")
            for head, length in zip(heads, lengths, strict=True)
        ]

    (nack,) = host.heard(b"".join(parts(host.tx.seq, 200)))
    assert isinstance(nack.message, Nack)
    assert nack.message.reason == NackReason.NOT_SUPPORTED
    host.tx.seq += 1
    first, _, *rest = parts(host.tx.seq, 200)
    assert host.heard(b"".join((first, *rest))) == []
    host.tx.seq += 1
    first, second, *rest = parts(host.tx.seq, 200)
    (nack,) = host.heard(b"".join((first, first, second, first, *rest)))  # repeated parts do no harm
    host.tx.seq += 1
    assert host.heard(b"".join(parts(host.tx.seq, 150 * 56 + 32))) == []
    host.tx.seq += 1
    host.say(RegisterRead(1))
    (status,) = host.say(Safe(1))
    assert isinstance(status, Status)
    assert (status.bad_frames, status.lost_seq) == (2, 2)


@pytest.mark.parametrize(("latency", "bits", "works"), [(15, 24, True), (16, 16, False), (1, 25, False)])
def test_configurations_that_cannot_work_are_refused(
    library: ctypes.CDLL, latency: int, bits: int, works: bool
) -> None:
    assert CBoard(library, latency=latency, bits=bits).works is works


def test_memory_bounds_the_block(library: ctypes.CDLL) -> None:
    assert not CBoard(library, rows=0).works
    host = Host(CBoard(library, rows=10), "serial")
    (answer,) = host.say(RegisterWrite(SPEC.registers["BLOCK"].id, 11))
    assert isinstance(answer, Nack)
    assert answer.reason == NackReason.NOT_SUPPORTED
    (answer,) = host.say(RegisterWrite(SPEC.registers["BLOCK"].id, 10))
    assert isinstance(answer, RegisterValue)


@pytest.mark.parametrize("kind", ["serial", "can"])
def test_codes_of_24_bits(library: ctypes.CDLL, kind: Literal["serial", "can"]) -> None:
    host = Host(CBoard(library, kind, bits=24), kind)
    sense = host.say(Arm())[-1]
    assert isinstance(sense, Sense)
    assert sense.width == 3
    assert sense.codes[0, :2].tolist() == [9001 - 10005, 7001 - 10011]
