"""Sequence numbers and ticks: nothing lost goes unnoticed, nothing is seen twice."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.wire.codec import pack, type_of
from hil.wire.errors import ProtocolError
from hil.wire.framing import encode_frame
from hil.wire.messages import DriveForce, Hello, Identity, Nack, NackReason, RegisterRead, Safe
from hil.wire.sense import Sense
from hil.wire.stream import REPEAT_RUN, REPEAT_WINDOW, Receiver, Transmitter, unwrap

untimed = settings(deadline=None)
IDENTITY = Identity(1, 2, 3, 4, 5.0, 2, 16, 16, 1.0, 1.0, 0, 0)


def frame(seq: int, tick: int = 0) -> bytes:
    return encode_frame(type_of(RegisterRead), seq, tick, pack(RegisterRead(1)))


def safe(seq: int, tick: int = 0, payload: bytes = b"\3") -> bytes:
    return encode_frame(type_of(Safe), seq, tick, payload)


def seqs(receiver: Receiver, data: bytes) -> list[int]:
    return [item.seq for item in receiver.feed(data)]


@pytest.mark.moderate
@untimed
@given(st.integers(0, 2**63), st.integers(-(2**31) + 1, 2**31 - 1))
def test_unwrap_finds_the_nearest_tick(near, step):
    tick = near + step
    if tick >= 0:
        assert unwrap(tick & 0xFFFFFFFF, near) == tick


def test_unwrap_never_goes_below_zero():
    assert unwrap(0xFFFFFFF0, 5) == 0xFFFFFFF0


def test_ticks_pass_the_wrap():
    transmitter, receiver = Transmitter(), Receiver()
    start = 2**32 - 3
    stream = [receiver.feed(transmitter.encode(RegisterRead(1), start + k)) for k in range(6)]
    assert [items[0].tick for items in stream] == list(range(start, start + 6))
    assert receiver.tick == start + 5


def test_sequence_passes_the_wrap():
    transmitter, receiver = Transmitter(), Receiver()
    transmitter.seq = 0xFFFE
    found = seqs(receiver, b"".join(transmitter.encode(RegisterRead(1), 0) for _ in range(4)))
    assert found == [0xFFFE, 0xFFFF, 0, 1]
    assert receiver.lost == receiver.repeated == 0


def test_the_first_frame_sets_the_sequence():
    receiver = Receiver()
    assert seqs(receiver, frame(500) + frame(501)) == [500, 501]
    assert receiver.lost == 0


def test_lost_frames_are_counted():
    receiver = Receiver()
    assert seqs(receiver, frame(0xFFFF) + frame(3)) == [0xFFFF, 3]
    assert receiver.lost == 3


def test_repeated_and_overtaken_frames_are_dropped():
    receiver = Receiver()
    assert seqs(receiver, frame(9) + frame(10) + frame(10) + frame(9) + frame(11)) == [9, 10, 11]
    assert receiver.repeated == 2
    assert receiver.lost == 0


def test_a_peer_that_jumps_far_back_is_heard():
    receiver = Receiver()
    assert seqs(receiver, frame(1000) + frame(1001 - REPEAT_WINDOW)) == [1000]
    assert receiver.repeated == 1
    assert seqs(receiver, frame(1000 - REPEAT_WINDOW) + frame(1001 - REPEAT_WINDOW)) == [744, 745]
    assert receiver.lost == 0x10000 - REPEAT_WINDOW - 1


@pytest.mark.parametrize("ahead", [5, 100, 200, 30000])
def test_one_stray_frame_far_ahead_costs_three_good_ones(ahead):
    """docs/wire.md: the fourth of a run of numbers behind the expected one is taken, and the count goes on from it."""
    receiver = Receiver()
    assert seqs(receiver, frame(50) + frame(51 + ahead)) == [50, 51 + ahead]
    good = b"".join(frame(51 + k) for k in range(10))
    behind = ahead + 1 <= REPEAT_WINDOW
    assert seqs(receiver, good) == list(range(51 + (REPEAT_RUN - 1) * behind, 61))
    assert seqs(receiver, frame(61)) == [61]
    assert receiver.repeated == (REPEAT_RUN - 1) * behind


def test_repetitions_that_do_not_follow_each_other_move_nothing():
    """Doubled frames, pairs of them, and a burst repeated between frames that are in order."""
    receiver = Receiver()
    assert seqs(receiver, b"".join(frame(k) for k in range(20))) == list(range(20))
    assert seqs(receiver, b"".join(map(frame, (5, 5, 6, 6, 5, 6, 7, 9, 10, 11, 1)))) == []
    for k in range(20, 30):
        assert seqs(receiver, frame(k) + frame(k - 10) + frame(k - 9) + frame(k - 8)) == [k]
    assert (receiver.lost, receiver.repeated) == (0, 11 + 30)


@pytest.mark.parametrize("seq", [0, 8, 9, 10, 11, 300, 0xFFFF])
@pytest.mark.parametrize("payload", [b"\3", b"", b"\3\0"])
def test_safe_stands_outside_the_sequence(seq, payload):
    """It is heard whatever its number, tick and length, as often as it comes, and moves nothing."""
    receiver = Receiver()
    seqs(receiver, frame(9, 70))
    heard = receiver.feed(safe(seq, 2**31, payload) * 2)
    assert [item.message for item in heard] == [Safe(3 if payload == b"\3" else 1)] * 2
    assert (receiver.tick, receiver.lost, receiver.repeated, receiver.bad) == (70, 0, 0, 0)
    assert seqs(receiver, frame(10, 71)) == [10]


def test_safe_spends_no_number():
    transmitter = Transmitter()
    transmitter.encode(RegisterRead(1), 0)
    transmitter.encode(Safe(1), 0)
    receiver = Receiver()
    assert seqs(receiver, transmitter.encode(Safe(1), 0) + transmitter.encode(RegisterRead(1), 0)) == [1, 1]
    assert transmitter.seq == 2


def test_what_only_the_other_end_says_is_refused_unread():
    receiver = Receiver(foreign=frozenset((0x20,)))
    assert receiver.feed(encode_frame(0x20, 4, 0, b"anything") + frame(5)) != []
    assert receiver.refused == [Nack(0x20, 4, NackReason.NOT_SUPPORTED)]
    assert (receiver.undecodable, receiver.lost) == (0, 0)


@pytest.mark.parametrize(
    ("n", "width", "rows"), [(0, 2, 0), (0, 2, 1), (2, 2, 1), (65535, 2, 1), (1, 7, 1), (1, 0, 0), (1, 1, 1), (1, 4, 1)]
)
def test_sense_that_contradicts_itself_is_no_row_and_no_time(n, width, rows):
    """Counted, dropped, and its tick not believed."""
    receiver = Receiver()
    receiver.feed(Transmitter().encode(Sense(np.array([(1, 2, 3, 4)], np.int32), 2, 0), 5))
    size = 4 * rows * (width if width in (1, 4, 7) else 2)
    data = encode_frame(0x20, 1, 9000, bytes((n & 0xFF, n >> 8, width, 0, 0)) + bytes(size))
    assert receiver.feed(data) == []
    assert (receiver.undecodable, receiver.bad, receiver.tick, receiver.lost) == (1, 1, 5, 0)


@pytest.mark.parametrize("opening", [Hello(1, 2), IDENTITY])
def test_opening_messages_restart_the_count(opening):
    receiver = Receiver()
    seqs(receiver, frame(100))
    assert seqs(receiver, encode_frame(type_of(opening), 50, 0, pack(opening)) + frame(51)) == [50, 51]
    assert receiver.lost == receiver.repeated == 0


def test_restart_forgets_place_but_not_counters():
    receiver = Receiver()
    seqs(receiver, frame(1, 70) + frame(5, 71))
    receiver.restart()
    assert receiver.tick == 0
    assert seqs(receiver, frame(0, 2)) == [0]
    assert (receiver.lost, receiver.repeated, receiver.tick) == (3, 0, 2)


def test_frames_that_cannot_be_understood_are_named_for_a_nack():
    receiver = Receiver()
    stream = encode_frame(0xEE, 0, 0, b"") + encode_frame(type_of(RegisterRead), 1, 0, b"too long") + frame(2)
    assert seqs(receiver, stream) == [2]
    assert receiver.refused == [
        Nack(0xEE, 0, NackReason.UNKNOWN_TYPE),
        Nack(type_of(RegisterRead), 1, NackReason.BAD_LENGTH),
    ]
    assert (receiver.undecodable, receiver.lost, receiver.bad) == (2, 0, 2)
    assert seqs(receiver, frame(3)) == [3]
    assert receiver.refused == []


def test_bad_counts_broken_frames_too():
    receiver = Receiver()
    receiver.feed(b"\0junk\0")
    assert receiver.bad == receiver.decoder.bad == 1


def test_a_message_that_does_not_fit_spends_no_number():
    transmitter = Transmitter()
    for attempt in (
        lambda: transmitter.encode(Safe(999), 0),
        lambda: transmitter.encode(Sense(np.array([(40000, 0, 0, 0)], np.int32), 2, 0), 0),
        lambda: transmitter.encode(DriveForce(2**31, 0, 0), 0),
    ):
        with pytest.raises(ProtocolError):
            attempt()
    assert transmitter.seq == 0


@pytest.mark.moderate
@untimed
@given(st.lists(st.binary(max_size=60), max_size=30))
def test_any_stream_is_survived(chunks):
    receiver = Receiver()
    for chunk in chunks:
        receiver.feed(chunk)
    assert receiver.decoder.bytes == sum(map(len, chunks))
