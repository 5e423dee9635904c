"""Framing: what goes in comes out, and nothing else ever does."""

from itertools import pairwise

import pytest
from cobs import cobs
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.wire.errors import ProtocolError
from hil.wire.frame_format import Frame
from hil.wire.framing import COBS_IN_C, MAX_ENCODED, Decoder, encode_frame, seal
from hil.wire.spec import SPEC

from .reference import cobs_decode, crc32c, open_frame

untimed = settings(deadline=None)
frames = st.builds(
    Frame,
    st.integers(0, 0xFF),
    st.integers(0, 0xFFFF),
    st.integers(0, 0xFFFFFFFF),
    st.binary(max_size=600),
)
noise = st.one_of(
    st.binary(max_size=400),
    st.lists(st.sampled_from([0, 1, 2, 3, 254, 255]), max_size=400).map(bytes),
    st.integers(MAX_ENCODED - 3, MAX_ENCODED + 300).map(lambda size: b"\xff" * size),
)


def counters(decoder: Decoder) -> dict[str, int]:
    names = ("bytes", "frames", "cobs_errors", "short", "crc_errors", "oversize", "dropped_bytes")
    return {name: getattr(decoder, name) for name in names}


def cut(data: bytes, places: list[int]) -> list[bytes]:
    bounds = [0, *sorted(place % (len(data) + 1) for place in places), len(data)]
    return [data[start:stop] for start, stop in pairwise(bounds)]


def test_the_installed_cobs_is_told_rightly():
    assert cobs.encode.__module__ == f"cobs.cobs._cobs_{'ext' if COBS_IN_C else 'py'}"


def test_crc_check_value():
    assert crc32c(b"123456789") == 0xE3069283


@pytest.mark.moderate
@untimed
@given(frames)
def test_a_frame_is_what_its_definition_says(frame):
    wire = encode_frame(*frame)
    assert wire.count(0) == 2
    head = frame.type.to_bytes(1, "little") + frame.seq.to_bytes(2, "little") + frame.tick.to_bytes(4, "little")
    assert open_frame(wire) == head + frame.payload


@pytest.mark.moderate
@untimed
@given(st.lists(frames, max_size=6))
def test_frames_come_back_in_order(sent):
    decoder = Decoder()
    assert decoder.feed(b"".join(encode_frame(*frame) for frame in sent)) == sent
    assert decoder.frames == len(sent)
    assert decoder.bad == decoder.dropped_bytes == len(decoder.rest) == 0


@pytest.mark.moderate
@untimed
@given(st.lists(frames, max_size=4))
def test_two_frames_may_share_a_delimiter(sent):
    runs = [encode_frame(*frame)[1:-1] for frame in sent]
    assert Decoder().feed(b"\0".join([b"", *runs, b""])) == sent


@pytest.mark.slow
@untimed
@given(
    st.lists(noise | frames.map(lambda frame: encode_frame(*frame)), max_size=5),
    st.lists(st.integers(0, 10**6)),
)
def test_chunking_changes_nothing(parts, places):
    stream = b"".join(parts)
    whole, pieces = Decoder(), Decoder()
    expected = whole.feed(stream)
    found = [frame for chunk in cut(stream, places) for frame in pieces.feed(chunk)]
    assert found == expected
    assert counters(pieces) == counters(whole)
    assert pieces.rest == whole.rest


@pytest.mark.moderate
@untimed
@given(st.lists(st.binary(max_size=2000), max_size=20))
def test_any_stream_is_survived_and_accounted_for(chunks):
    decoder = Decoder()
    for chunk in chunks:
        decoder.feed(chunk)
        assert len(decoder.rest) <= MAX_ENCODED
    stream = b"".join(chunks)
    decoder.feed(b"\0")
    runs = [run for run in stream.split(b"\0") if run]
    assert decoder.bytes == len(stream) + 1
    assert decoder.frames + decoder.bad == len(runs)
    assert decoder.rest == b""


@pytest.mark.moderate
@untimed
@given(noise, frames)
def test_place_is_found_again_at_the_next_delimiter(garbage, frame):
    decoder = Decoder()
    assert decoder.feed(garbage + encode_frame(*frame))[-1] == frame


@pytest.mark.moderate
@untimed
@given(frames, st.data())
def test_a_damaged_frame_is_never_taken_for_another(frame, data):
    """A flipped bit may shift what COBS makes of the rest; the checksum misses one such frame in 4e9."""
    wire = bytearray(encode_frame(*frame))
    for place in data.draw(st.sets(st.integers(8, 8 * (len(wire) - 1) - 1), min_size=1, max_size=3)):
        wire[place // 8] ^= 1 << place % 8
    assert all(found == frame for found in Decoder().feed(bytes(wire)))


def test_every_single_bit_error_is_seen():
    frame = Frame(0x20, 513, 70000, bytes(range(12)))
    wire = encode_frame(*frame)
    for place in range(8, 8 * (len(wire) - 1)):
        damaged = bytearray(wire)
        damaged[place // 8] ^= 1 << place % 8
        decoder = Decoder()
        assert decoder.feed(bytes(damaged)) == []
        assert decoder.bad >= 1


def test_memory_stays_bounded_without_any_delimiter():
    decoder = Decoder()
    for _ in range(1000):
        assert decoder.feed(b"\x01" * 4096) == []
        assert len(decoder.rest) <= MAX_ENCODED
    assert decoder.oversize == 1
    assert decoder.dropped_bytes == 1000 * 4096
    frame = Frame(1, 2, 3, b"still here")
    assert decoder.feed(encode_frame(*frame)) == [frame]


def test_longest_payload_passes_and_a_longer_one_does_not():
    payload = b"\xaa" * SPEC.max_payload
    frame = Frame(1, 2, 3, payload)
    wire = encode_frame(*frame)
    assert len(wire) - 2 <= MAX_ENCODED
    assert Decoder().feed(wire) == [frame]
    with pytest.raises(ProtocolError, match=r"SENSE: 8193 bytes; a payload has at most 8192"):
        encode_frame(0x20, 0, 0, payload + b"\0")


def test_bytes_too_long_for_a_frame_are_oversize():
    decoder = Decoder()
    assert decoder.feed(b"\0" + b"\1" * (MAX_ENCODED + 1) + b"\0") == []
    assert (decoder.oversize, decoder.bad) == (1, 1)


def test_a_longer_frame_that_still_looks_possible_is_oversize():
    """Payloads without zeros have the longest encoding; a shorter one must be judged after decoding."""
    decoder = Decoder()
    assert decoder.feed(seal(b"\0" * 7 + b"\0" * (SPEC.max_payload + 1))) == []
    assert decoder.oversize == 1


def test_header_numbers_wrap():
    assert Decoder().feed(encode_frame(1, 0x10002, 0x1_0000_0003, b"")) == [Frame(1, 2, 3, b"")]


@pytest.mark.parametrize(
    ("plain", "stuffed"),
    [
        ("", "01"),
        ("00", "0101"),
        ("0000", "010101"),
        ("11220033", "0311220233"),
        ("11223344", "0511223344"),
        ("11000000", "0211010101"),
        (bytes(range(1, 255)).hex(), "ff" + bytes(range(1, 255)).hex()),
        ((b"\0" + bytes(range(1, 255))).hex(), "01ff" + bytes(range(1, 255)).hex()),
        (bytes(range(1, 256)).hex(), "ff" + bytes(range(1, 255)).hex() + "02ff"),
    ],
)
def test_cobs_as_published(plain, stuffed):
    assert cobs.encode(bytes.fromhex(plain)).hex() == stuffed
    assert cobs.decode(bytes.fromhex(stuffed)).hex() == plain
    assert cobs_decode(bytes.fromhex(stuffed)).hex() == plain
