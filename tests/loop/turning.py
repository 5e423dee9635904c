"""The receiving half of the turn in C beside the Python one, fed with the same bytes; by itself, too, with a library
built under sanitizers: `python -m tests.loop.turning BYTES`."""

import ctypes
import random
import sys

import numpy as np

from hil.loop.native import LIBRARY, MOST_ROWS, NONE, ROW, SAID, SAID_ROOM, Batch, ReceiverState, payload_sizes
from hil.wire.codec import pack, type_of, unpack
from hil.wire.framing import encode_frame
from hil.wire.messages import Identity, Message, Nack, Safe, Status, TimeSync
from hil.wire.sense import Sense
from hil.wire.stream import Received, Receiver

COUNTERS = ("bytes", "frames", "cobs_errors", "short", "crc_errors", "oversize", "dropped_bytes")
FOLLOWED = ("lost", "repeated", "undecodable", "passed_over", "tick")


class CReceiver:
    """Bytes in, messages out, as `hil.wire.stream.Receiver`; of SENSE the rows."""

    def __init__(self) -> None:
        self.state = ReceiverState(expected=NONE)
        self._rows = np.zeros(2 * MOST_ROWS, ROW)
        self._said = np.zeros(SAID_ROOM, np.uint8)
        self._sizes = payload_sizes()
        self._batch = Batch(
            rows=self._rows.ctypes.data,
            row_room=len(self._rows),
            said=self._said.ctypes.data,
            said_room=len(self._said),
            sizes=ctypes.addressof(self._sizes),
        )

    def feed(self, data: bytes) -> tuple[list[tuple[int, ...]], list[Received]]:
        """Rows (tick, vx, vy, ux, uy, flags), and what else came."""
        rows: list[tuple[int, ...]] = []
        said: list[Received] = []
        while data:
            taken = LIBRARY.turn_feed(ctypes.byref(self.state), ctypes.byref(self._batch), data, len(data))
            data = data[taken:]
            rows += [row[:6] for row in self._rows[: self._batch.row_count].tolist()]
            at = 0
            while at < self._batch.said_size:
                _, tick, kind, seq, size, _ = np.frombuffer(self._said, SAID, 1, at).tolist()[0]
                at += SAID.itemsize
                said.append(Received(tick, seq, unpack(kind, self._said[at : at + size].tobytes())))
                at += -(-size // 8) * 8
            self._batch.row_count = self._batch.said_size = 0
        return rows, said

    def counts(self) -> dict[str, int]:
        return {name: getattr(self.state, name) for name in COUNTERS + FOLLOWED}


def in_python(receiver: Receiver, data: bytes) -> tuple[list[tuple[int, ...]], list[Received]]:
    """What the Python receiver makes of the same bytes, in the same form."""
    rows: list[tuple[int, ...]] = []
    said = []
    for item in receiver.feed(data):
        if isinstance(item.message, Sense):
            sense = item.message
            rows += [(tick, *codes, sense.flags) for tick, codes in enumerate(sense.codes.tolist(), item.tick)]
        else:
            said.append(item)
    return rows, said


def counts(receiver: Receiver) -> dict[str, int]:
    """Its counters, by the same names."""
    found = {name: getattr(receiver.decoder, name) for name in COUNTERS}
    return found | {name: getattr(receiver, name) for name in FOLLOWED}


def stream(dice: random.Random, size: int) -> bytes:
    """Frames of a board, some of them spoilt: numbers that jump or repeat, bits and bytes that changed, noise, runs
    that never end, lengths and types that are none."""
    made = bytearray()
    seq, tick = 0, 0
    while len(made) < size:
        seq += dice.choice((1,) * 30 + (0, 2, 3, 300, -1, -5, 40000))
        tick += dice.choice((1,) * 20 + (5, -3, 1 << 31))
        frame = bytearray(_frame(dice, seq & 0xFFFF, tick & 0xFFFFFFFF))
        fate = dice.random()
        if fate < 0.05:
            frame[dice.randrange(len(frame))] ^= 1 << dice.randrange(8)
        elif fate < 0.08:
            del frame[dice.randrange(len(frame)) :]
        elif fate < 0.10:
            frame += dice.randbytes(dice.randrange(1, 60))
        elif fate < 0.102:
            frame += bytes(dice.choices(range(1, 256), k=dice.randrange(8000, 30000)))
        made += frame
    return bytes(made)


def _frame(dice: random.Random, seq: int, tick: int) -> bytes:
    kind = dice.random()
    if kind < 0.75:
        width = dice.choice((2, 2, 2, 3))
        most = 1 << (8 * width - 1)
        rows = dice.choice((1,) * 10 + (2, 7, 250))
        codes = np.array([[dice.randrange(-most, most) for _ in range(4)] for _ in range(rows)], np.int32)
        message: Message = Sense(codes, width, dice.randrange(8), dice.randrange(256))
    elif kind < 0.95:
        message = dice.choice(
            (
                Status(3, 0, *[dice.randrange(1 << 32) for _ in range(7)], tick),
                Nack(0x10, seq, 3),
                TimeSync(dice.randrange(1 << 63), 0),
                Safe(4),
                Identity(3, 0, 1, 2, 4e3, 2, 16, 16, 1e-5, 1e-5, 1, 15),
            )
        )
    else:  # of any type and length
        return encode_frame(dice.randrange(256), seq, tick, dice.randbytes(dice.randrange(80)))
    return encode_frame(type_of(message), seq, tick, pack(message))


def compare(size: int, seed: int) -> int:
    """Feed both with `size` bytes, cut anywhere, and compare after each cut; how many messages there were."""
    dice = random.Random(seed)
    data = stream(dice, size)
    c, python, found, at = CReceiver(), Receiver(), 0, 0
    while at < len(data):
        end = at + dice.choice((1, 2, 11, 24, 300, 4096, 20000))
        ours, theirs = c.feed(data[at:end]), in_python(python, data[at:end])
        assert ours == theirs, (at, end)
        assert c.counts() == counts(python), (at, end)
        found += len(ours[0]) + len(ours[1])
        at = end
    return found


if __name__ == "__main__":
    print("all", compare(int(sys.argv[1]), 1))
