"""Frames on CAN: read once more from the page by hand, joined, cut, damaged."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.wire.can_format import FDF, HEAD, RECORD_SIZE, CanFormat
from hil.wire.codec import type_of
from hil.wire.errors import ProtocolError
from hil.wire.frame_format import BOARD, HOST, UNSEQUENCED
from hil.wire.messages import Arm, DriveForce, FieldValue, Hello, Nack, NackReason, Safe, SafeReason, SenseFlags, Status
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter

VECTORS = json.loads(Path(__file__).with_name("golden.json").read_text(encoding="utf-8"))["frames"]
LEGAL = {*range(9), 12, 16, 20, 24, 32, 48, 64}
LONG = FieldValue(3, 200, "é" * 100)  # 204 bytes: four parts


def records(data: bytes) -> list[bytes]:
    assert len(data) % RECORD_SIZE == 0
    return [data[at : at + RECORD_SIZE] for at in range(0, len(data), RECORD_SIZE)]


def record(identifier: int, body: bytes, length: int | None = None, flags: int = 0) -> bytes:
    return HEAD.pack(identifier, len(body) if length is None else length, flags) + body.ljust(64, b"\0")


def pair(node: int = 0) -> tuple[Transmitter, Receiver]:
    """From the board to the host."""
    return Transmitter(CanFormat(node, BOARD)), Receiver(CanFormat(node, HOST))


def test_a_stretch_of_records_is_cut_into_whole_ones_and_the_rest() -> None:
    one, two = record(0x101, b"\1"), record(0x102, b"\2\3")
    cut = CanFormat(0, BOARD).cut
    assert cut(one + two + one[:71]) == ([one, two], one[:71])
    assert cut(one + two) == ([one, two], b"")
    assert cut(b"") == ([], b"")


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: vector["name"])
def test_golden_frames_by_hand(vector):
    """What docs/wire.md says, with `struct` alone."""
    layout = SPEC.messages[vector["message"]]
    brief = [f for f in vector["can"] if f["id"] == f"0x{0x33 << 4 | 1:03x}"]
    frames = [f for f in vector["can"] if f not in brief]
    assert len(brief) == (vector["message"] == "STATUS")
    payload = b""
    for k, frame in enumerate(frames):
        data = bytes.fromhex(frame["data"])
        assert int(frame["id"], 0) == layout.type << 4 | (layout.sender == "board")
        assert len(data) in LEGAL
        assert frame["fd"] == (vector["message"] not in {"SAFE", "ARM"})
        if vector["message"] == "SAFE":
            assert data == struct.pack("<BHI", vector["fields"]["reason"], vector["seq"], vector["tick"])
            return
        if vector["message"] == "ARM":
            assert data == struct.pack("<HI", vector["seq"], vector["tick"])
            return
        seq, tick, size, part = struct.unpack_from("<HIBB", data)
        if vector["message"] == "SENSE":
            count, width, flags = size & 7, 2 + (size >> 3 & 1), size >> 4
            fields = vector["fields"]
            assert (width, flags, part) == (fields["width"], fields["flags"], fields["matrix_id"])
            assert seq == (vector["seq"] + k) & 0xFFFF
            assert tick == (vector["tick"] + len(payload) // (4 * width)) & 0xFFFFFFFF
            payload += data[8 : 8 + 4 * width * count]
            assert set(data[8 + 4 * width * count :]) <= {0}
        else:
            assert (seq, tick, part) == (vector["seq"], vector["tick"], k)
            assert (size == 56) == (k < len(frames) - 1)
            payload += data[8 : 8 + size]
            assert set(data[8 + size :]) <= {0}
    whole = bytes.fromhex(vector["payload"])
    assert payload == (whole[5:] if vector["message"] == "SENSE" else whole)
    for frame in brief:
        fields = vector["fields"]
        data = bytes.fromhex(frame["data"])
        assert not frame["fd"]
        assert struct.unpack("<BBBBI", data) == (
            fields["state"], fields["reason"], min(fields["lost_seq"], 255), min(fields["watchdog_trips"], 255),
            fields["tick"],
        )  # fmt: skip


def test_classic_layouts_of_messages_have_their_types():
    for name in ("SAFE", "ARM"):
        assert SPEC.can.classic[name].type == SPEC.messages[name].type
        assert SPEC.can.classic[name].sender == SPEC.messages[name].sender
    assert SPEC.can.classic["STATUS_BRIEF"].type not in {m.type for m in SPEC.messages.values()}
    assert all(layout.size <= 8 for layout in SPEC.can.classic.values())


def test_everything_fits_its_bits():
    assert max(m.type for m in SPEC.messages.values()) < 1 << 11 - SPEC.can.type_shift
    assert max(SenseFlags) < 16


@pytest.mark.moderate
@given(
    st.integers(0, 2**40), st.integers(1, 60), st.sampled_from([2, 3]), st.integers(0, 7), st.integers(0, 7),
    st.integers(0, 255), st.integers(1, 200),
)  # fmt: skip
def test_blocks_arrive_as_they_were(tick, count, width, flags, node, matrix, chunk):
    limit = 1 << 8 * width - 1
    codes = np.random.default_rng(tick).integers(-limit, limit, (count, 4)).astype(np.int32)
    tx, rx = pair(node)
    data = tx.encode(Sense(codes, width, flags, matrix), tick)
    got = [item for at in range(0, len(data), chunk) for item in rx.feed(data[at : at + chunk])]
    assert np.array_equal(np.concatenate([item.message.codes for item in got]), codes)
    ticks = [item.tick for item in got]
    assert [(t - tick) % 2**32 for t in ticks] == list(range(0, count, 7 if width == 2 else 4))
    assert {(item.message.flags, item.message.matrix_id) for item in got} == {(flags, matrix)}
    assert tx.seq == len(got)
    assert rx.lost == rx.bad == 0


def test_a_lost_frame_of_a_block_is_a_gap_of_its_rows():
    tx, rx = pair()
    data = tx.encode(Sense(np.zeros((21, 4), np.int32), 2, 0), 100)
    first, _, last = records(data)
    assert [item.tick for item in rx.feed(first + last)] == [100, 114]
    assert rx.lost == 1


def test_codes_that_do_not_fit():
    tx, _ = pair()
    for width, code in ((2, 32768), (3, 2**23), (4, 0)):
        with pytest.raises(ProtocolError, match="SENSE"):
            tx.encode(Sense(np.array([(code, 0, 0, 0)], np.int32), width, 0), 0)
    with pytest.raises(ProtocolError, match="DRIVE_FORCE"):
        tx.encode(DriveForce(2**31, 0, 0), 0)
    with pytest.raises(ProtocolError, match="FIELD_VALUE: 9004 bytes; a payload has at most 8192"):
        tx.encode(FieldValue(0, 1, "x" * 9000), 0)
    assert tx.seq == 0


def test_long_messages_are_joined():
    for size in (0, 51, 52, 53, 108, 164, 8188):
        tx, rx = pair()
        message = FieldValue(1, 2, "y" * size)
        data = tx.encode(message, 9)
        assert len(records(data)) == (size + 4) // 56 + 1
        assert [item[:] for item in rx.feed(data)] == [(9, 0, message)]
        assert tx.seq == 1


def test_a_missing_part_costs_its_message_only():
    for missing in range(4):
        tx, rx = pair()
        parts = records(tx.encode(LONG, 0))
        assert len(parts) == 4
        del parts[missing]
        after = tx.encode(Nack(1, 2, 3), 0)
        again = tx.encode(LONG, 0)
        rx.feed(tx.encode(Nack(1, 2, 3), 0))
        rx.restart()
        got = rx.feed(b"".join(parts) + after + again)
        assert [item.message for item in got] == [Nack(1, 2, 3), LONG]
        assert rx.decoder.broken == (missing > 0)  # without its first part it shows only as a gap in the sequence


def test_repeated_parts_do_no_harm():
    tx, rx = pair()
    parts = records(tx.encode(LONG, 0))
    assert [item.message for item in rx.feed(b"".join(part * 2 for part in parts))] == [LONG]
    assert rx.feed(b"".join(parts)) == []
    assert (rx.repeated, rx.bad, rx.lost) == (1, 0, 0)


def test_safe_from_any_node():
    """`cansend can0 010#01`, and with no data at all."""
    host, rx = Transmitter(CanFormat(0, HOST)), Receiver(CanFormat(0, BOARD))
    rx.feed(host.encode(Hello(1, 2), 0) + host.encode(Arm(), 7))
    for body, reason in ((b"\1", 1), (b"", SafeReason.HOST_REQUEST), (b"\6", 6)):
        (item,) = rx.feed(record(0x010, body))
        assert item == (7, 0, Safe(reason))
    for body, flags in ((b"\5\0", 0), (bytes(8), 0), (struct.pack("<HIBB", 5, 0, 1, 0) + b"\5\0\0\0", FDF)):
        (item,) = rx.feed(record(0x010, body, flags=flags))
        assert item == (7, 0, Safe(SafeReason.HOST_REQUEST))  # of a length that SAFE has not, or as CAN FD
    (item,) = rx.feed(host.encode(Safe(3), 8))
    assert item == (7, 2, Safe(3))  # its tick is not looked at
    assert (rx.lost, rx.repeated, rx.bad) == (0, 0, 0)
    assert UNSEQUENCED not in range(0x10000)


def test_brief_status_is_for_others():
    tx, rx = pair()
    status = Status(3, 0, 1, 2, 3, 999, 5, 256, 6, 7)
    fd, brief = records(tx.encode(status, 7))
    assert [item.message for item in rx.feed(fd + brief)] == [status]
    assert brief[8:16] == bytes([3, 0, 255, 255, 7, 0, 0, 0])
    assert HEAD.unpack_from(brief) == (0x331, 8, 0)
    assert HEAD.unpack_from(fd) == (0x311, 48, 1 | FDF)
    assert rx.bad == rx.lost == 0


def test_other_traffic_is_passed_over():
    host = Transmitter(CanFormat(0, HOST))
    rx = Receiver(CanFormat(0, BOARD))
    own = host.encode(Hello(1, 2), 0)
    (identifier,) = struct.unpack_from("=I", own)
    strangers = [
        Transmitter(CanFormat(1, HOST)).encode(Hello(1, 2), 0),
        Transmitter(CanFormat(0, BOARD)).encode(Nack(1, 2, 3), 0),
        record(identifier | 1 << 31, own[8:22]),  # 29-bit identifier
        record(identifier | 1 << 30, b""),  # remote transmission request
        record(1 << 29, bytes(8)),  # error frame
    ]
    assert rx.feed(b"".join(strangers)) == []
    assert rx.bad == rx.decoder.frames == 0
    assert [item.message for item in rx.feed(own)] == [Hello(1, 2)]


def test_unknown_types_are_refused():
    rx = Receiver(CanFormat(2, BOARD))
    assert rx.feed(record(0x7F << 4 | 2 << 1, struct.pack("<HIBB", 5, 0, 0, 0))) == []
    assert rx.refused == [Nack(0x7F, 5, NackReason.UNKNOWN_TYPE)]


@pytest.mark.parametrize(
    ("type_", "body", "length"),
    [
        ("HELLO", b"\0\0\0\0\0\0\6", 7),
        ("HELLO", struct.pack("<HIBB6s", 0, 0, 6, 0, b""), 64),
        ("HELLO", struct.pack("<HIBB", 0, 0, 57, 0), 64),
        ("HELLO", struct.pack("<HIBB", 0, 0, 255, 0), 64),
        ("ARM", b"", 0),
        ("ARM", bytes(8), 8),
        ("SENSE", struct.pack("<HIBB", 0, 0, 0, 0), 8),
        ("SENSE", struct.pack("<HIBB", 0, 0, 7, 0), 48),
        ("SENSE", struct.pack("<HIBB", 0, 0, 8 | 5, 0), 64),
        ("SENSE", b"\0", 1),
    ],
)
def test_lengths_that_contradict_the_content(type_, body, length):
    rx = Receiver(CanFormat(0, BOARD))
    assert rx.feed(record(SPEC.messages[type_].type << 4, body, length)) == []
    assert (rx.bad, rx.decoder.malformed) == (1, 1)


def test_a_message_longer_than_any_is_dropped():
    rx = Receiver(CanFormat(0, BOARD))
    parts = [struct.pack("<HIBB", 0, 0, 56, k) + bytes(56) for k in range(150)]
    parts.append(struct.pack("<HIBB", 0, 0, 0, 150))
    assert rx.feed(b"".join(record(0x400, part) for part in parts)) == []
    assert rx.decoder.malformed == 1


@pytest.mark.moderate
@settings(max_examples=200)
@given(st.binary(max_size=2000), st.integers(1, 300))
def test_any_bytes_at_all(noise, chunk):
    """Nothing raises, and how the stream is cut changes nothing."""
    starts = [HEAD.pack(t << 4, 64, 4) for t in (1, 2, 0x20, 0x40)]
    data = b"".join(
        start + noise[at : at + 64].ljust(64, b"\0")
        for at, start in zip(range(0, len(noise), 64), starts * 10, strict=False)
    )
    data += noise
    whole, cut = Receiver(CanFormat(0, 1)), Receiver(CanFormat(0, 1))
    expected = whole.frames(data)
    assert [f for at in range(0, len(data), chunk) for f in cut.frames(data[at : at + chunk])] == expected
    assert (whole.bad, whole.decoder.bytes) == (cut.bad, len(data))


def test_a_drive_in_the_midst_of_a_long_message_breaks_it():
    rx = Receiver(CanFormat(0, BOARD))
    host = Transmitter(CanFormat(0, HOST))
    part = records(host.encode(FieldValue(1, 1, "x" * 100), 0))[0]
    rx.feed(part)
    drive = host.encode(DriveForce(1, 2, 3), 0)
    assert [type_of(item.message) for item in rx.feed(drive)] == [0x10]
    assert rx.decoder.broken == 1
