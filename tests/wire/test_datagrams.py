"""What all links of whole frames share (`hil.wire.datagram_link`), on a pair of sockets without a network."""

import errno
import os
import socket
import time
from collections.abc import Iterator

import pytest

from hil.wire.datagram_link import DatagramLink
from hil.wire.errors import LinkClosed
from hil.wire.link import Claim
from hil.wire.serial_format import SERIAL

FOREIGN = b"foreign"


class Paired(DatagramLink):
    """Datagrams of five bytes; those of a stranger are dropped."""

    def __init__(self, wire: socket.socket) -> None:
        claim = Claim(f"test-datagrams-{os.getpid()}-{wire.fileno()}", "pair", "end the other")
        super().__init__(wire, "pair:1", SERIAL, claim, "is it on?")
        self.fails: OSError | None = None

    def _put(self, datagram: bytes) -> None:
        if self.fails is not None:
            raise self.fails
        self._wire.send(datagram)

    def _out(self, data: bytes) -> list[tuple[bytes, int]]:
        return [(data[at : at + 5], len(data[at : at + 5])) for at in range(0, len(data), 5)]

    def _in(self, datagram: bytes, source: object) -> bytes | None:
        return None if datagram == FOREIGN else datagram


@pytest.fixture
def ends() -> Iterator[tuple[Paired, socket.socket]]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    link = Paired(ours)
    yield link, theirs
    link.close()
    theirs.close()


def test_full_queues_are_waited_for(ends: tuple[Paired, socket.socket]) -> None:
    link, peer = ends
    fits = link.offer(b"abcde" * 5000)
    assert 0 < fits < 25000
    assert fits % 5 == 0
    tried = 0

    def sleep(seconds: float) -> None:
        nonlocal tried
        assert 0.0 < seconds <= 1e-3
        tried += 1
        assert tried < 10
        for _ in range(3):
            peer.recv(100)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("hil.wire.datagram_link.time.sleep", sleep)
        link.send(b"12345" * 7)
    assert tried == 3
    assert link.dropped_bytes == 0


def test_or_what_finds_no_room_is_lost_and_counted(ends: tuple[Paired, socket.socket]) -> None:
    link, _ = ends
    link.drop_when_full = True
    link.offer(b"abcde" * 5000)
    link.send(b"12345" * 7)
    assert link.dropped_bytes == 35
    link.send(b"12345")
    assert link.dropped_bytes == 40


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENETDOWN, "the interface is down"),
        (errno.ENODEV, "the interface is gone"),
        (errno.ENXIO, "the interface is gone"),
        (errno.ENETUNREACH, "there is no way to this network"),
        (errno.EBADF, "the link is closed"),
        (errno.EPERM, os.strerror(errno.EPERM)),
    ],
)
def test_what_went_wrong_is_told_in_words(ends: tuple[Paired, socket.socket], number: int, words: str) -> None:
    ends[0].fails = OSError(number, "as the system says")
    with pytest.raises(LinkClosed) as told:
        ends[0].send(b"abcde")
    assert str(told.value) == f"pair:1: {words}"


def test_strangers_are_not_taken_for_the_peers_silence(ends: tuple[Paired, socket.socket]) -> None:
    link, peer = ends
    peer.send(FOREIGN)
    peer.send(FOREIGN)
    begin = time.monotonic()
    assert link.receive(0.05) == b""
    assert time.monotonic() - begin >= 0.05
    peer.send(FOREIGN)
    assert link.receive(0.0) == b""
    peer.send(FOREIGN)
    peer.send(b"aaaaa")
    assert link.receive(None) == b"aaaaa"


def test_a_frame_is_stamped_by_the_kernel_where_it_stamps(ends: tuple[Paired, socket.socket]) -> None:
    link, peer = ends
    assert link._wire.getsockopt(socket.SOL_SOCKET, 35) == 1  # SO_TIMESTAMPNS, asm-generic/socket.h
    before = time.monotonic_ns()
    peer.send(b"aaaaa")
    time.sleep(0.02)
    after = time.monotonic_ns()
    assert link.receive(1.0) == b"aaaaa"
    assert before - 1_000_000 < link.arrived_ns < after - 10_000_000


def test_what_came_before_the_wire_broke_is_given_first(
    ends: tuple[Paired, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Breaking:
        """A socket with two datagrams, whose interface then goes."""

        left = 2

        def fileno(self) -> int:
            return 0

        def recvmsg(self, *_: int) -> tuple[bytes, list[object], int, None]:
            if not self.left:
                raise OSError(errno.ENETDOWN, "")
            self.left -= 1
            return b"abcde", [], 0, None

    link, _ = ends
    wire = link._wire
    monkeypatch.setattr(link, "_wire", Breaking())
    assert link.receive(0.0) == b"abcdeabcde"
    with pytest.raises(LinkClosed, match="the interface is down"):
        link.receive(0.0)
    monkeypatch.setattr(link, "_wire", wire)


def test_what_the_last_host_left_is_dropped_for_the_next(ends: tuple[Paired, socket.socket]) -> None:
    link, peer = ends
    for _ in range(3):
        peer.send(b"aaaaa")
    link.await_host()
    assert link.receive(0.0) == b""
    link.close()
    link.await_host()  # of a closed one nothing is asked
    assert link.fileno() == -1
    with pytest.raises(LinkClosed, match="the link is closed"):
        link.receive(0.0)
