"""The two ends of a UDP link (docs/security.md, rules 1 to 8), with sessions and sockets that only note what they are
told; and what the system's own sockets are set to.
"""

import errno
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.wire import udp_link
from hil.wire.claim import Claim
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.frame_format import BOARD, HOST
from hil.wire.key_file import make_key
from hil.wire.link_name import UdpGroup
from hil.wire.links import open_board_link, open_link
from hil.wire.session import LEFT, Heard
from hil.wire.udp_link import UdpBoard, UdpHost, open_udp
from tests.wire.multicast import group
from tests.wire.sockets import Sockets

PLACE = group(3)
GROUP = PLACE.rpartition(":")[0], int(PLACE.rpartition(":")[2])
ONE, OTHER = ("127.0.0.1", 5001), ("127.0.0.1", 5002)
FRAME = b"\0abc\0"


class Session:
    """`hears` is what the next datagram brings, `seals` what becomes of a frame."""

    def __init__(self) -> None:
        self.refused, self.busy = 7, False
        self.hears = Heard(FRAME)
        self.seals: bytes | None = b"sealed"
        self.told: list[Any] = []

    def seal(self, frame: bytes) -> bytes | None:
        self.told.append(frame)
        return self.seals

    def leave(self) -> bytes | None:
        return self.seals

    def heard(self, datagram: bytes, **where: bool) -> Heard:
        self.told.append((datagram, where))
        return self.hears


class Socket(socket.socket):
    """Notes what is sent to whom; may fail at it."""

    def note(self) -> "Socket":
        self.sent: list[tuple[bytes, Any]] = []
        self.fails: OSError | None = None
        return self

    def sendto(self, data: bytes, address: Any) -> int:
        if self.fails is not None:
            raise self.fails
        self.sent.append((data, address))
        return len(data)


def wire() -> Socket:
    return Socket(socket.AF_INET, socket.SOCK_DGRAM).note()


def claim() -> Claim:
    return Claim(f"test-udp-{os.getpid()}", "udp", "end it")


class Host:
    def __init__(self, board: Any = ONE) -> None:
        self.session, self.wire = Session(), wire()
        self.link = UdpHost(self.wire, "udp:x", GROUP, board, self.session, claim())


class Board:
    def __init__(self) -> None:
        self.session, self.hears, self.wire = Session(), wire(), wire()
        self.link = UdpBoard(self.hears, self.wire, "udp:x", self.session, claim())

    def meet(self, source: Any) -> None:
        self.session.hears = Heard(FRAME, opened=True)
        assert self.link._in(b"d", source) == FRAME
        self.session.hears = Heard(FRAME)


@pytest.fixture
def host() -> Iterator[Host]:
    found = Host()
    yield found
    found.link.close()


@pytest.fixture
def board() -> Iterator[Board]:
    found = Board()
    yield found
    found.link.close()


# ---------------------------------------------------------------------------------------------------------------- host


def test_a_host_sends_to_the_group_what_the_session_makes_of_a_frame(host: Host) -> None:
    assert host.link.offer(FRAME) == 5
    assert host.wire.sent == [(b"sealed", GROUP)]
    assert host.session.told == [FRAME]
    host.session.seals = None  # nothing but HELLO before there is a session
    host.link.send(FRAME)
    assert len(host.wire.sent) == 1


def test_each_frame_is_a_datagram(host: Host) -> None:
    for data, frames in (
        (b"\0ab\0", [b"\0ab\0"]),
        (b"ab\0", [b"ab\0"]),
        (b"\0ab\0\0cde\0", [b"\0ab\0", b"\0cde\0"]),
        (b"\0a\0\0\0b\0", [b"\0a\0", b"\0b\0"]),
    ):
        assert [datagram for datagram, _ in host.link._out(data)] == frames
    assert sum(size for _, size in host.link._out(b"\0ab\0\0cde\0")) == 9
    assert host.link._out(b"\0ab\0") == [(b"\0ab\0", 4)]


def test_only_the_boards_address_is_heard_where_no_key_tells(host: Host) -> None:
    assert host.link.strangers == 7  # those of the session
    assert host.link._in(b"d", OTHER) is None
    assert host.link._in(b"d", OTHER) is None
    assert host.link.strangers == 9
    assert host.link._in(b"d", ONE) == FRAME
    assert host.session.told == [(b"d", {})]


def test_with_a_key_any_address_is() -> None:
    host = Host(board=None)
    assert host.link._in(b"d", OTHER) == FRAME
    assert host.link.strangers == 7
    host.link.close()


def test_a_reply_goes_to_the_group_and_may_be_lost(host: Host) -> None:
    host.session.hears = Heard(None, b"reply")
    assert host.link._in(b"d", ONE) is None
    assert host.wire.sent == [(b"reply", GROUP)]
    host.wire.fails = OSError(errno.ENETDOWN, "")
    assert host.link._in(b"d", ONE) is None


def test_a_board_that_another_host_has_is_advised_about(host: Host) -> None:
    host.link._in(b"d", ONE)
    assert host.link.advice.startswith("is the board on, in the same network")
    host.session.busy = True
    host.link._in(b"d", ONE)
    assert host.link.advice == "another host is using this board; end it there"


def test_a_host_that_closes_leaves_once(host: Host) -> None:
    host.link.close()
    host.link.close()
    assert host.wire.sent == [(b"sealed", GROUP)]
    with pytest.raises(LinkClosed, match="the link is closed"):
        host.link.send(FRAME)


@pytest.mark.parametrize("why", ["no session", "no network"])
def test_a_host_that_cannot_leave_closes(host: Host, why: str) -> None:
    if why == "no session":
        host.session.seals = None
    else:
        host.wire.fails = OSError(errno.ENETDOWN, "")
    host.link.close()
    assert host.wire.sent == []
    assert host.wire.fileno() == -1


# --------------------------------------------------------------------------------------------------------------- board


def test_a_board_without_a_host_says_nothing(board: Board) -> None:
    board.link.send(FRAME)
    assert board.session.told == []
    assert board.wire.sent == []
    assert board.link.strangers == 7


def test_a_board_answers_the_host_that_opened_a_session(board: Board) -> None:
    board.meet(ONE)
    assert board.session.told[-1] == (b"d", {"from_peer": False, "taken": False})
    board.link.send(FRAME)
    assert board.wire.sent == [(b"sealed", ONE)]
    assert board.hears.sent == []
    board.session.seals = None
    board.link.send(FRAME)
    assert len(board.wire.sent) == 1
    assert board.link._in(b"d", ONE) == FRAME
    assert board.session.told[-1] == (b"d", {"from_peer": True, "taken": False})
    board.link._in(b"d", OTHER)
    assert board.session.told[-1] == (b"d", {"from_peer": False, "taken": True})


def test_a_frame_from_elsewhere_makes_no_peer(board: Board) -> None:
    board.meet(ONE)
    assert board.link._in(b"d", OTHER) == FRAME
    board.link.send(FRAME)
    assert board.wire.sent[-1][1] == ONE
    board.meet(OTHER)
    board.link.send(FRAME)
    assert board.wire.sent[-1][1] == OTHER


def test_a_host_that_speaks_keeps_the_board(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [1000.0]
    monkeypatch.setattr("hil.wire.session.time.monotonic", lambda: now[0])
    board.meet(ONE)
    for _ in range(3):
        now[0] += 0.8
        assert board.link._in(b"d", ONE) == FRAME
        board.link._in(b"d", OTHER)
        assert board.session.told[-1][1]["taken"] is True
    now[0] += 1.1
    board.link._in(b"d", OTHER)
    assert board.session.told[-1][1]["taken"] is False


def test_a_reply_goes_back_to_where_it_was_asked(board: Board) -> None:
    board.session.hears = Heard(None, b"reply")
    assert board.link._in(b"d", OTHER) is None
    assert board.wire.sent == [(b"reply", OTHER)]
    board.wire.fails = OSError(errno.ENETDOWN, "")
    assert board.link._in(b"d", OTHER) is None


def test_what_was_dropped_makes_no_peer_and_a_host_that_leaves_is_none(board: Board) -> None:
    board.session.hears = Heard(None, opened=True)
    assert board.link._in(b"d", ONE) is None
    board.link.send(FRAME)
    assert board.wire.sent == []
    board.meet(ONE)
    board.session.hears = Heard(LEFT)
    assert board.link._in(b"d", ONE) is None
    board.link.send(FRAME)
    assert board.wire.sent == []


def test_a_board_closes_both_sockets(board: Board) -> None:
    assert not board.wire.getblocking()
    board.link.close()
    board.link.close()
    assert (board.wire.fileno(), board.hears.fileno()) == (-1, -1)
    with pytest.raises(LinkClosed, match="the link is closed"):
        board.link.send(FRAME)


# ------------------------------------------------------------------------------------------------------------- opening


def test_sockets_stay_in_this_network_and_hear_their_own_group() -> None:
    """linux/in.h: IP_MULTICAST_ALL is 49."""
    reference = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    reference.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 2**20)
    held = reference.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    reference.close()
    board, host = open_board_link(f"udp:{PLACE}"), open_link(f"udp:{PLACE}")
    try:
        for one in (board._wire, board._speaks, host._wire):
            assert one.getsockopt(socket.IPPROTO_IP, 49) == 0
            assert one.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 1
            assert one.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF) == 0x0100007F  # 127.0.0.1, as in memory
            assert one.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) == held
        assert board._wire.getsockname() == GROUP
        assert board._speaks.getsockname() == ("127.0.0.1", GROUP[1])
        assert host._wire.getsockname()[0] == "127.0.0.1"
        assert (board.name, host.name) == (f"udp:{PLACE}", f"udp:{PLACE}")
        assert (board.strangers, host.strangers) == (0, 0)
    finally:
        host.close()
        board.close()


def test_options_are_in_the_name(tmp_path: Path) -> None:
    make_key(tmp_path / "a.key")
    for query in ("", "?interface=127.0.0.1", f"?key={tmp_path / 'a.key'}"):
        for opened in (open_link, open_board_link):
            link = opened(f"udp:{PLACE}{query}")
            assert link.name == f"udp:{PLACE}{query}"
            link.close()
    link = open_udp(UdpGroup(PLACE, "127.0.0.1", str(tmp_path / "a.key")), HOST)
    assert link.name == f"udp:{PLACE}?interface=127.0.0.1&key={tmp_path / 'a.key'}"
    link.close()


@pytest.mark.parametrize("port", [1, 65534])
def test_ports_of_a_group(monkeypatch: pytest.MonkeyPatch, port: int) -> None:
    bound: list[Any] = []

    def note(name: str, local: str, address: Any, group: Any) -> Socket:
        bound.append((local, address, group))
        return wire()

    monkeypatch.setattr(udp_link, "_bound", note)
    open_udp(UdpGroup(f"239.0.0.1:{port}"), HOST).close()
    open_udp(UdpGroup(f"239.0.0.1:{port}"), BOARD).close()
    local = "127.0.0.1"
    assert bound == [(local, (local, 0), None), (local, ("239.0.0.1", port), "239.0.0.1"), (local, (local, port), None)]


@pytest.mark.parametrize("place", ["239.0.0.1:0", "239.0.0.1:65535", "239.0.0.1:x", "x:1", "240.0.0.1:1", ":1", "1"])
def test_what_is_no_group_and_port(place: str) -> None:
    with pytest.raises(LinkError, match=f"udp:{place}: expected a multicast group and a port"):
        open_udp(UdpGroup(place), HOST)


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENODEV, "no network interface has the address 127.0.0.1; see `ip address`"),
        (errno.ENETUNREACH, "no network interface has the address 127.0.0.1; see `ip address`"),
        (errno.EADDRNOTAVAIL, "no network interface has the address 127.0.0.1; see `ip address`"),
        (errno.EADDRINUSE, "another program has port {port}; end it, or take another port"),
        (errno.EPERM, "Operation not permitted"),
    ],
)
@pytest.mark.parametrize("second", [False, True])
def test_what_a_socket_is_refused_for(monkeypatch: pytest.MonkeyPatch, number: int, words: str, second: bool) -> None:
    """The first or the second of a board; either way nothing stays open, and the name is free."""
    bound: list[socket.socket] = []

    class Refusing(socket.socket):
        def bind(self, address: Any) -> None:
            bound.append(self)
            if not second or len(bound) % 2 == 0:
                raise OSError(number, os.strerror(number))
            super().bind(address)

    monkeypatch.setattr(udp_link, "socket", Sockets(Refusing))
    for _ in range(2):
        with pytest.raises(LinkError) as told:
            open_udp(UdpGroup(PLACE), BOARD)
        assert str(told.value) == f"udp:{PLACE}: {words.format(port=GROUP[1])}"
    assert all(one.fileno() == -1 for one in bound)


def test_one_program_has_each_end() -> None:
    for sender, words in ((HOST, "another host on this machine has this link"), (BOARD, "another board serves this")):
        first = open_udp(UdpGroup(PLACE), sender)
        with pytest.raises(LinkError, match=words):
            open_udp(UdpGroup(PLACE), sender)
        first.close()
