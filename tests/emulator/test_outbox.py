"""The outbox: whole messages in order, however little the link takes at a time, and never more than it may hold."""

from device_emulator.outbox import Outbox
from hil.wire.fd_link import FdLink


class Narrow(FdLink):
    """A link that takes a few bytes at a time, and none when it is full."""

    def __init__(self, room: int) -> None:
        self.room = room
        self.taken = b""

    def offer(self, data: bytes | memoryview) -> int:
        part = bytes(data[: self.room])
        self.taken += part
        self.room -= len(part)
        return len(part)


def test_messages_stay_whole_and_in_order() -> None:
    link = Narrow(3)
    outbox = Outbox(link, 100)
    for message in (b"hello", b"", b"board"):
        assert outbox.put(message, droppable=True)
    assert (link.taken, len(outbox)) == (b"hel", 7)
    for _ in range(3):
        link.room = 3
        outbox.flush()
    assert (link.taken, len(outbox)) == (b"helloboard", 0)


def test_what_finds_no_room_is_refused_whole_and_urgent_words_are_not() -> None:
    link = Narrow(0)
    outbox = Outbox(link, 10)
    assert outbox.put(b"12345678", droppable=True)
    assert not outbox.put(b"abc", droppable=True)
    assert outbox.put(b"SAFE")
    link.room = 5
    assert outbox.put(b"xyz", droppable=True)  # by then there is room again
    link.room = 100
    outbox.flush()
    assert link.taken == b"12345678SAFExyz"


def test_a_host_that_is_gone_is_owed_nothing() -> None:
    link = Narrow(0)
    outbox = Outbox(link, 10)
    outbox.put(b"old")
    outbox.clear()
    link.room = 10
    outbox.put(b"new")
    assert (link.taken, len(outbox)) == (b"new", 0)
