"""Framing in C beside framing in Python: the same frames and the same counters on any stream."""

import ctypes
import random
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.wire.framing import MAX_ENCODED, Decoder, Frame, encode_frame
from hil.wire.spec import SPEC

from .c_reader import CReader, write_frame

CORPUS = Path(__file__).parents[1] / "wire" / "corpus.toml"
untimed = settings(deadline=None, max_examples=60)
frames = st.builds(
    Frame, st.integers(0, 0xFF), st.integers(0, 0xFFFF), st.integers(0, 0xFFFFFFFF), st.binary(max_size=1200)
)
noise = st.one_of(st.binary(max_size=400), st.lists(st.sampled_from([0, 1, 2, 3, 254, 255]), max_size=400).map(bytes))


def counters(decoder: Decoder) -> dict[str, int]:
    return {name: getattr(decoder, name) for name in ("frames", "cobs_errors", "short", "crc_errors", "oversize")}


def agree(library: ctypes.CDLL, stream: bytes) -> CReader:
    ours, theirs = CReader(library), Decoder()
    assert ours.feed(stream) == theirs.feed(stream)
    assert ours.counters == counters(theirs)
    return ours


def test_crc_check_value(library: ctypes.CDLL) -> None:
    crc = 0xFFFFFFFF
    library.hil_crc32c_byte.restype = ctypes.c_uint32
    for byte in b"123456789":
        crc = library.hil_crc32c_byte(ctypes.c_uint32(crc), ctypes.c_uint8(byte))
    assert crc ^ 0xFFFFFFFF == 0xE3069283


@pytest.mark.moderate
@untimed
@given(frame=frames)
def test_both_sides_write_the_same(library: ctypes.CDLL, frame: Frame) -> None:
    pieces = write_frame(library, frame)
    assert b"".join(pieces) == encode_frame(*frame)
    assert all(len(piece) <= 512 for piece in pieces)
    assert len(pieces) == 1 or sum(map(len, pieces)) > 256


@pytest.mark.moderate
@untimed
@given(size=st.integers(240, 260), last=st.integers(0, 1))
def test_the_longest_groups_of_cobs(library: ctypes.CDLL, size: int, last: int) -> None:
    frame = Frame(1, 0x0101, 0x01010101, b"\x07" * size + bytes([last]))
    assert b"".join(write_frame(library, frame)) == encode_frame(*frame)


@pytest.mark.moderate
@untimed
@given(parts=st.lists(noise | frames.map(lambda frame: encode_frame(*frame)), max_size=5), damage=st.data())
def test_both_sides_read_the_same(library: ctypes.CDLL, parts: list[bytes], damage: st.DataObject) -> None:
    stream = bytearray(b"".join(parts))
    for place in damage.draw(st.sets(st.integers(0, max(8 * len(stream) - 1, 0)), max_size=3)):
        if stream:
            stream[place // 8] ^= 1 << place % 8
    agree(library, bytes(stream) + b"\0")


@pytest.mark.parametrize("stream", tomllib.loads(CORPUS.read_text())["stream"], ids=lambda stream: stream["name"])
def test_streams_that_were_awkward(library: ctypes.CDLL, stream: dict[str, str]) -> None:
    whole = encode_frame(1, 8, 100, b"\2")[1:-1]
    parts = {"safe": whole, "safe_tail": whole[7:], "safe_head": whole[:7], "safe_minus_one": whole[1:]}
    agree(library, bytes.fromhex(stream["hex"].format(**{name: part.hex() for name, part in parts.items()})))


@pytest.mark.moderate
def test_longest_frames_and_longer_ones(library: ctypes.CDLL) -> None:
    payload = bytes(random.Random(1).choices(range(1, 256), k=SPEC.max_payload))
    (found,) = agree(library, encode_frame(1, 2, 3, payload)).feed(encode_frame(1, 2, 4, payload))
    assert found == Frame(1, 2, 4, payload)
    agree(library, b"\x01" * MAX_ENCODED + b"\0" + encode_frame(1, 2, 3, b"on"))
    agree(library, b"\x01" * (MAX_ENCODED + 1) + b"\0" + encode_frame(1, 2, 3, b"on"))
    agree(library, b"\xff" * 100_000 + b"\0" + encode_frame(1, 2, 3, b"on"))


def test_a_frame_longer_than_the_room_is_judged_and_told_as_what_it_is(library: ctypes.CDLL) -> None:
    """A board needs no memory for frames that are not meant for it, and still refuses them by name."""
    reader = CReader(library, room=11 + 4)
    (found,) = reader.feed(encode_frame(9, 1, 2, b"0123456789"))
    assert (found.payload[:4], reader.size) == (b"0123", 10)
    damaged = bytearray(encode_frame(9, 1, 2, b"0123456789"))
    damaged[-4] ^= 1  # far beyond the room
    assert reader.feed(bytes(damaged)) == []
    assert reader.counters["crc_errors"] == 1
