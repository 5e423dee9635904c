"""The fuzz corpus: awkward streams with hand-counted outcomes, whole, byte by byte, and mutated."""

import random
import tomllib
from pathlib import Path

import pytest

from hil.wire.framing import MAX_ENCODED, Decoder, encode_frame

SAFE = encode_frame(1, 8, 100, b"\x02")[1:-1]
PARTS = {"safe": SAFE, "safe_head": SAFE[:7], "safe_tail": SAFE[-6:], "safe_minus_one": SAFE[:3] + SAFE[4:]}
STREAMS = tomllib.loads(Path(__file__).with_name("corpus.toml").read_text(encoding="utf-8"))["stream"]
COUNTERS = ("frames", "cobs_errors", "short", "crc_errors", "oversize", "dropped_bytes")


def content(stream) -> bytes:
    return bytes.fromhex(stream["hex"].format(**{name: part.hex() for name, part in PARTS.items()}))


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: stream["name"])
@pytest.mark.parametrize("size", [1, 3, 10**6], ids=["bytewise", "by threes", "whole"])
def test_outcome(stream, size):
    data = content(stream)
    decoder = Decoder()
    frames = [frame for k in range(0, len(data), size) for frame in decoder.feed(data[k : k + size])]
    assert {name: getattr(decoder, name) for name in COUNTERS} == {name: stream.get(name, 0) for name in COUNTERS}
    assert frames == [(1, 8, 100, b"\x02")] * decoder.frames
    assert decoder.bytes == len(data)


@pytest.mark.moderate
def test_mutations():
    """Seeded, so that a failure can be repeated: bytes changed, deleted, doubled; chunks of any size."""
    draw = random.Random(1)
    seeds = [content(stream) for stream in STREAMS]
    for _ in range(2000):
        data = bytearray(b"".join(draw.choices(seeds, k=draw.randint(1, 4))))
        for _ in range(draw.randint(1, 8)):
            place = draw.randrange(len(data) + 1)
            data[place : place + draw.randint(0, 2)] = draw.randbytes(draw.randint(0, 3))
        decoder = Decoder()
        frames = []
        rest = bytes(data)
        while rest:
            size = draw.randint(1, 40)
            frames += decoder.feed(rest[:size])
            rest = rest[size:]
            assert len(decoder.rest) <= MAX_ENCODED
        assert set(frames) <= {(1, 8, 100, b"\x02")}
        assert decoder.feed(b"\0\0" + SAFE + b"\0")[-1] == (1, 8, 100, b"\x02")
