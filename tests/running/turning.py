"""The receiving half of the turn in C beside the Python one, fed with the same bytes; by itself, too, with a library
built under sanitizers: `python -m tests.running.turning BYTES`."""

import ctypes
import random
import sys
from collections.abc import Iterator

import numpy as np

from hil.records.runfolder import RunFolder
from hil.running.native import (
    LIBRARY,
    MOST_ROWS,
    NONE,
    ROW,
    SAID,
    SAID_ROOM,
    Batch,
    CanState,
    ReceiverState,
    payload_sizes,
)
from hil.wire.can_format import RECORD_SIZE, CanFormat
from hil.wire.codec import pack, type_of, unpack
from hil.wire.frame_format import BOARD, HOST, FrameFormat
from hil.wire.framing import encode_frame
from hil.wire.messages import Identity, Message, Nack, Safe, Status, TimeSync
from hil.wire.sense import Sense
from hil.wire.stream import Received, Receiver, Transmitter

COUNTERS = ("bytes", "frames", "cobs_errors", "short", "crc_errors", "oversize", "dropped_bytes")
CAN = ("bytes", "frames", "malformed", "broken")
NODE = 3
FOLLOWED = ("lost", "repeated", "undecodable", "passed_over", "tick")


class CReceiver:
    """Bytes in, messages out, as `hil.wire.stream.Receiver`; of SENSE the rows. With `can` records of that bus."""

    def __init__(self, can: CanState | None = None) -> None:
        self.can = can
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
            taken = LIBRARY.turn_feed(
                ctypes.byref(self.state),
                None if self.can is None else ctypes.byref(self.can),
                ctypes.byref(self._batch),
                data,
                len(data),
            )
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


def both_on_can(node: int) -> tuple[CReceiver, Receiver]:
    """Receivers of a host, in C and in Python."""
    return CReceiver(CanState(node=node, unfinished=NONE)), Receiver(CanFormat(node, HOST))


def can_counts(receiver: CReceiver | Receiver) -> list[int]:
    """Counters of frames, and of messages."""
    if isinstance(receiver, CReceiver):
        return [getattr(receiver.can, name) for name in CAN] + [getattr(receiver.state, name) for name in FOLLOWED]
    return [getattr(receiver.decoder, name) for name in CAN] + [getattr(receiver, name) for name in FOLLOWED]


def records(dice: random.Random, count: int) -> Iterator[bytes]:
    """Frames of a board and of others; numbers, bits, lengths and orders spoilt now and then."""
    form, seq, made = CanFormat(NODE, BOARD), 0, list[bytes]()
    while len(made) < count:
        seq = seq + dice.choice((1,) * 20 + (0, 2, 300, -1)) & 0xFFFF
        tick = dice.randrange(1 << 32)
        kind = dice.random()
        if kind < 0.5:
            width = dice.choice((2, 3))
            codes = np.array([[dice.randrange(-(1 << 15), 1 << 15) for _ in range(4)]], np.int32)
            data, _ = form.encode(type_of(Sense), seq, tick, pack(Sense(codes, width, dice.randrange(8))))
        elif kind < 0.9:
            message = dice.choice(
                (
                    Status(3, 0, *[dice.randrange(1 << 32) for _ in range(7)], tick),
                    Nack(0x10, seq, 3),
                    Safe(4),
                    Identity(3, 0, 1, 2, 4e3, 2, 16, 16, 1e-5, 1e-5, 1, 15),
                )
            )
            data, _ = form.encode(type_of(message), seq, tick, pack(message))
        else:
            data, _ = form.encode(dice.choice((0x22, 0x50, 0x5E, 0x7E)), seq, tick, dice.randbytes(dice.randrange(300)))
        made += [data[at : at + RECORD_SIZE] for at in range(0, len(data), RECORD_SIZE)]
    for record in made:
        spoilt, fate = bytearray(record), dice.random()
        if fate < 0.1:
            spoilt[dice.randrange(24)] ^= 1 << dice.randrange(8)
        if not 0.1 < fate < 0.13:
            yield bytes(spoilt)
        if 0.13 < fate < 0.18:
            yield bytes(spoilt)


def compare_can(count: int, seed: int) -> list[int]:
    """The same as `compare` of so many frames of CAN; what was counted."""
    c, python = both_on_can(NODE)
    for number, record in enumerate(records(random.Random(seed), count)):
        assert c.feed(record) == in_python(python, record), number
    assert can_counts(c) == can_counts(python)
    return can_counts(c)


def sent_as_python_does(sent: list[bytes], host: FrameFormat, board: FrameFormat) -> int:
    """Each frame of a host beside what Python makes of the same message; SAFE has neither number nor tick.  How many
    there were."""
    receiver, found = Receiver(board), 0
    for data in sent:
        for item in receiver.feed(data):
            if not isinstance(item.message, Safe):
                transmitter = Transmitter(host)
                transmitter.seq = item.seq
                assert transmitter.encode(item.message, item.tick) == data
                found += 1
    return found


def recorded_as_python_reads(run: RunFolder, heard: list[bytes], host: FrameFormat) -> None:
    """The samples of a capture beside those that Python reads in the same bytes."""
    receiver, capture = Receiver(host), run.capture
    assert capture is not None
    rows = [row[:5] for data in heard for row in in_python(receiver, data)[0]][: len(capture)]
    names = ("tick", "vx_code", "vy_code", "ux_code", "uy_code")
    np.testing.assert_array_equal(np.column_stack([capture.columns[name] for name in names]), rows)


if __name__ == "__main__":
    print("all", compare(int(sys.argv[1]), 1), compare_can(int(sys.argv[1]) // 50, 1))
