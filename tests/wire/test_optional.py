"""Optional parts: outside of the hash, passed over where they are not known; and the protocol before, in one line."""

import re
from pathlib import Path

import pytest
from crc32c import crc32c

from device_emulator.board import Board
from device_emulator.device import Device
from hil.running.process.optional import unknown_parts
from hil.wire import client, spec
from hil.wire.codec import KNOWN_TYPES, pack, type_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.framing import encode_frame
from hil.wire.messages import (
    Arm,
    Capabilities,
    ClockMode,
    FieldRead,
    FieldValue,
    Hello,
    Identity,
    Nack,
    NackReason,
)
from hil.wire.serial_format import SERIAL
from hil.wire.spec import SPEC, parse_spec
from hil.wire.stream import Receiver, Transmitter
from tests.emulator.gyro import scenario

TEXT = Path(spec.__file__).with_name("spec.toml").read_text(encoding="utf-8")
OLD_TABLE = Path(__file__).with_name("field-table-3.tsv").read_text(encoding="utf-8").split("\n")
OLD_PROTOCOL, OLD_HASH = 3, 0x4E8B482D
"""What was published of protocol 3 (docs/reference/wire-changes.md)."""

MORE = """
[optional.HEALTH]
bit = 128
doc = "Later than this."

[optional.HEALTH.messages.HEALTH]
type = 0x53
sender = "board"
doc = "A temperature."
fields = [{ name = "temp", type = "f32", unit = "°C", doc = "It." }]

[optional.HEALTH.registers.HEALTH_EVERY]
id = 0x0031
unit = "tick"
access = "rw"
live = true
default = 0
minimum = 0
maximum = 10
doc = "Stride."

[optional.HEALTH.flags.HealthFlags]
doc = "Bits."
HOT = 1
"""

IDENTITY = Identity(SPEC.protocol, SPEC.hash, 1, 1, 4000.0, 2, 16, 16, 1e-5, 1e-4, 1, int(Capabilities(15)))


class Answering:
    """A link whose other end answers each message by what `answer` makes of it."""

    format = SERIAL
    name, advice, arrived_ns = "there", "", 0

    def __init__(self, answer) -> None:
        self._answer, self._rx, self._tx, self._said = answer, Receiver(), Transmitter(), b""

    def fileno(self):
        return None

    def send(self, data: bytes) -> None:
        for frame in self._rx.decoder.feed(data):
            self._said += b"".join(self._answer(frame))

    def receive(self, timeout_s):
        said, self._said = self._said, b""
        return said

    def close(self) -> None:
        """Nothing to close."""


def test_the_published_table_of_protocol_3_is_the_one_that_was_hashed():
    assert crc32c("\n".join(OLD_TABLE).encode()) == OLD_HASH


def test_one_more_optional_part_changes_neither_hash_nor_table():
    later = parse_spec(TEXT + MORE)
    assert (later.hash, later.table, later.protocol) == (SPEC.hash, SPEC.table, SPEC.protocol)
    assert later.messages["HEALTH"].optional == later.registers["HEALTH_EVERY"].optional == "HEALTH"
    assert later.enums["Capabilities"].members["HEALTH"] == 128
    assert later.is_optional(later.messages["HEALTH"].type)


def test_nor_does_one_that_is_taken_away():
    without = re.sub(r"\[optional\.ESTIMATE\].*?(?=\n# -{20,} states)", "", TEXT, flags=re.S)
    earlier = parse_spec(without)
    assert "ESTIMATE" not in earlier.messages
    assert earlier.hash == SPEC.hash


def test_a_message_outside_the_optional_parts_does_change_it():
    part = MORE[MORE.index("[optional.HEALTH.messages") : MORE.index("[optional.HEALTH.registers")]
    assert parse_spec(TEXT + part.replace("optional.HEALTH.", "")).hash != SPEC.hash


def test_parts_keep_to_their_types_bits_and_registers():
    """Types in the range of optional ones and no other message there, bits and registers of nobody else."""
    for message in SPEC.messages.values():
        assert SPEC.is_optional(message.type) is bool(message.optional)
    plain = [bit for name, bit in SPEC.enums["Capabilities"].members.items() if name not in SPEC.optional]
    bits = [part.bit for part in SPEC.optional.values()]
    assert not set(bits) & set(plain)
    assert all(bit.bit_count() == 1 for bit in bits)


def test_the_layout_of_a_published_part_never_changes():
    """What hosts and boards already speak: another layout is another part."""
    told = [entry for field in SPEC.messages["ESTIMATE"].fields for entry in field.entry("ESTIMATE")[1:]]
    assert SPEC.messages["ESTIMATE"].size == 176
    assert crc32c("\t".join(told).encode()) == 0xC12EB389


def test_no_field_lies_across_two_can_frames():
    at, room = 0, 56
    for field in SPEC.messages["ESTIMATE"].fields:
        size = field.bits // 8
        assert at // room == (at + size - 1) // room, field.name
        at += size


def test_a_host_passes_over_an_optional_message_that_it_does_not_know():
    unknown = SPEC.optional_types[1]
    assert unknown not in KNOWN_TYPES
    host = Receiver()
    frames = [encode_frame(unknown, seq, 7, bytes(30)) for seq in range(1000)]
    assert host.feed(b"".join(frames) + encode_frame(type_of(Nack), 1000, 9, pack(Nack(1, 2, 3))))[0].tick == 9
    assert (host.passed_over, host.undecodable, host.bad, host.lost, host.refused) == (1000, 0, 0, 0, [])
    (line,) = unknown_parts(IDENTITY, host.passed_over)
    assert line == "1000 optional messages of the board passed over, unknown here; update the host to use it"


def test_a_host_works_with_a_board_that_can_do_more_and_says_so():
    more = IDENTITY._replace(capabilities=IDENTITY.capabilities | 0x80)

    def board(frame):
        yield encode_frame(type_of(Identity), 0, 0, pack(more))

    assert client.connect(Endpoint(Answering(board)), 0.5) == more
    (line,) = unknown_parts(more, 0)
    assert line == "the board can do more than this host knows (capabilities 0x80); update the host to use it"
    assert unknown_parts(IDENTITY, 0) == []


def test_an_old_board_is_refused_by_this_host_in_one_line():
    """A board of protocol 3, as published: both numbers, both hashes, the first line that differs, what to do."""
    seq = iter(range(1 << 16))

    def board(frame):
        if frame.type == type_of(Hello):
            old = IDENTITY._replace(protocol=OLD_PROTOCOL, spec_hash=OLD_HASH)
            yield encode_frame(type_of(Identity), next(seq), 0, pack(old))
        elif frame.type == type_of(FieldRead):
            line = int.from_bytes(frame.payload, "little")
            yield encode_frame(
                type_of(FieldValue), next(seq), 0, pack(FieldValue(line, len(OLD_TABLE), OLD_TABLE[line]))
            )

    with pytest.raises(ProtocolError) as refusal:
        client.connect(Endpoint(Answering(board)), 2.0)
    told = str(refusal.value)
    assert "the board speaks protocol 3, this host 4; spec hash 0x4e8b482d on the board" in told
    assert "this host has DRIVE_BOARD (0x12, host), the board does not" in told
    assert told.endswith("; update the firmware (docs/reference/wire-changes.md)")
    assert "\n" not in told


def test_an_old_host_is_answered_by_this_board_and_not_let_arm():
    """A host of protocol 3 can read who the board is and where the tables differ; nothing is armed for it."""
    slow = scenario()
    board, said = Board(slow, Device(slow), (ClockMode.LOCKSTEP,)), Transmitter()
    heard = Receiver()

    def ask(message):
        return [item.message for item in heard.feed(board.exchange(said.encode(message, 0)))]

    (identity,) = ask(Hello(OLD_PROTOCOL, OLD_HASH))
    assert (identity.protocol, identity.spec_hash) == (SPEC.protocol, SPEC.hash)
    assert [line.split("\t")[:3] for line in OLD_TABLE if line.startswith("IDENTITY\t")] == [
        list(entry[:3]) for entry in SPEC.table if entry.message == "IDENTITY"
    ]
    (line,) = ask(FieldRead(0))
    assert line.lines == len(SPEC.table)
    (nack,) = ask(Arm())
    assert nack.reason == NackReason.BAD_STATE
