"""Noise, damaged frames and senseless messages into every decoder.

The Python decoders, of serial lines and of CAN, here; the C ones, with a whole board behind them, in `firmware/fuzz`
under AddressSanitizer and UndefinedBehaviorSanitizer.  A frame that is taken though nobody sent it is corrupt.  Of
runs with intact COBS the checksum misses one in 2³², if the damage is of any kind.  CAN's own checksum is
the controller's business, so there nothing but survival is looked at.
"""

import json
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hil.wire.can_format import RECORD_SIZE, CanFormat
from hil.wire.codec import unpack
from hil.wire.errors import ProtocolError
from hil.wire.frame_format import BOARD, HOST, Frame
from hil.wire.framing import Decoder, encode_frame
from hil.wire.spec import SPEC

POOL = 2000  # valid frames of one helping
HELPING = 1_000_000  # bytes, about
CHUNK = 4096


@dataclass
class Tally:
    """What a decoder was fed and what it made of it."""

    bytes: int = 0
    taken: int = 0
    corrupt: int = 0
    checked: int = 0
    messages: int = 0


def frames(random: np.random.Generator) -> list[Frame]:
    """Valid frames: every type there is and some there are not, payloads of the right length, mostly."""
    layouts = list(SPEC.messages.values())
    made = []
    for _ in range(POOL):
        layout = layouts[random.integers(len(layouts))]
        known = random.random() < 0.9
        size = layout.size + 8 * int(random.integers(20)) * layout.open_ended if known else int(random.integers(300))
        payload = random.integers(0, (256, 3)[random.random() < 0.3], size, np.uint8).tobytes()
        if layout.name == "SENSE" and known:
            n = (size - layout.size) // 8
            payload = n.to_bytes(2, "little") + b"\2\0\0" + payload[5:]
        type_ = layout.type if known else int(random.integers(256))
        made.append(Frame(type_, int(random.integers(1 << 16)), int(random.integers(1 << 32)), payload))
    made.append(Frame(0x46, 1, 2, random.bytes(SPEC.max_payload)))
    return made


def good(frame: Frame) -> bool:
    """Whether a frame holds a message."""
    try:
        unpack(frame.type, frame.payload)
    except ProtocolError:
        return False
    return True


def stream(random: np.random.Generator, sent: list[Frame]) -> bytes:
    """The frames in any order, many of them damaged: bits turned over, bytes lost or come from nowhere, noise."""
    wire = [encode_frame(*frame) for frame in sent]
    total, parts = 0, []
    while total < HELPING:
        kind = random.random()
        part = wire[random.integers(len(wire))] if kind < 0.97 else random.bytes(int(random.integers(600)))
        if 0.97 <= kind < 0.985:
            part = bytes(np.frombuffer(part, np.uint8) % 4)  # zeros, and short groups
        parts.append(part)
        total += len(part)
    data = np.frombuffer(b"".join(parts), np.uint8).copy()
    turned = random.integers(0, len(data), len(data) // 150)
    data[turned] ^= (1 << random.integers(0, 8, len(turned))).astype(np.uint8)
    data = np.delete(data, random.integers(0, len(data), len(data) // 1000))
    where = random.integers(0, len(data), len(data) // 1000)
    return np.insert(data, where, random.integers(0, 256, len(where))).tobytes()


def chunks(random: np.random.Generator, data: bytes) -> Iterator[bytes]:
    """As reads cut a stream: of any size up to 4096."""
    at = 0
    while at < len(data):
        size = int(random.integers(1, CHUNK + 1))
        yield data[at : at + size]
        at += size


def feed_serial(amount: int, seed: int) -> Tally:
    """Feed the decoder of serial lines, and the codecs behind it."""
    random = np.random.default_rng(seed)
    decoder, tally = Decoder(), Tally()
    while tally.bytes < amount:
        pool = frames(random)
        known = set(pool)
        data = stream(random, pool) + b"\0"  # what is left over must not end as a frame of the next helping
        cut = list(chunks(random, data))
        for chunk in cut:
            for frame in decoder.feed(chunk):
                tally.taken += 1
                tally.corrupt += frame not in known
                tally.messages += good(frame)
        tally.bytes += len(data)
    tally.checked = decoder.frames + decoder.crc_errors
    if decoder.bytes < tally.bytes or decoder.frames != tally.taken:
        raise RuntimeError(f"the decoder counted {decoder.frames} frames and gave {tally.taken}")
    return tally


def feed_can(amount: int, seed: int) -> Tally:
    """Feed the decoder of CAN frames, and the codecs behind it: what a bus brings with any bits turned over."""
    random = np.random.default_rng(seed)
    tally = Tally()
    decoders = [CanFormat(0, end).decoder() for end in (HOST, BOARD)]
    while tally.bytes < amount:
        parts = [
            CanFormat(0, (HOST, BOARD)[k % 2]).encode(*frame)[0]
            for k, frame in enumerate(frames(random))
            if good(frame)
        ]
        records = np.frombuffer(b"".join(parts), np.uint8).reshape(-1, RECORD_SIZE).copy()
        records = np.repeat(records, 8, axis=0)[random.permutation(8 * len(records))]
        count = len(records) // 2
        rows, columns = random.integers(0, len(records), count), random.integers(0, RECORD_SIZE, count)
        records[rows, columns] ^= (1 << random.integers(0, 8, count)).astype(np.uint8)
        records[:, 4] %= 65  # the kernel passes no frame of more
        data = records.tobytes()
        cut = list(chunks(random, data))
        for chunk in cut:
            for decoder in decoders:
                for frame in decoder.feed(chunk):
                    tally.taken += 1
                    tally.messages += good(frame)
        tally.bytes += len(data)
    return tally


def feed_c(program: Path, amount: int, seed: int) -> Tally:
    """Run the C fuzzer. Raises CalledProcessError when a sanitizer, or the fuzzer itself, has found something."""
    done = subprocess.run([program, str(amount), str(seed)], check=True, capture_output=True, text=True)
    told = json.loads(done.stdout)
    return Tally(told["bytes"], told["taken"], told["corrupt"], told["checked"], told["answers"])
