"""How the sockets of a UDP link are opened (docs/security.md, rules 1 to 3), and what a name that opens none is told.

Who is heard: test_sessions.py, and through sockets test_keyed.py.
"""

import errno
import os
import socket
from pathlib import Path
from typing import Any

import pytest

from hil.wire import udp_link
from hil.wire.errors import LinkError
from hil.wire.frame_format import BOARD, HOST
from hil.wire.key_file import make_key
from hil.wire.link_name import UdpGroup
from hil.wire.links import open_board_link, open_link
from hil.wire.udp_link import open_udp
from tests.wire.multicast import group
from tests.wire.sockets import Sockets

PLACE = group(3)
GROUP = PLACE.rpartition(":")[0], int(PLACE.rpartition(":")[2])


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
