"""UDP: a datagram per frame, framed as on a serial line, so that checksum and sequence are checked.

A multicast group and a port are where a board is met: the host sends there, from a port of its own, and the board
answers to that port, from the interface and the port of the group. Both sockets are held exclusively, so no other
program of the machine can be taken for either end. Off the machine addresses prove nothing, and a key is needed.
docs/security.md has the rules.
"""

import errno
import ipaddress
import socket
import struct
from contextlib import suppress
from pathlib import Path

from hil.wire.datagram_link import DatagramLink, Source
from hil.wire.errors import LinkError
from hil.wire.frame_format import HOST, Sender
from hil.wire.key_file import read_key
from hil.wire.keyed import Address, KeyedBoard, KeyedHost, Peer, PlainBoard, PlainHost
from hil.wire.link import Claim
from hil.wire.link_name import UdpGroup
from hil.wire.serial_format import SERIAL

_BUFFER = 1 << 22  # bytes to hold while a reader is away; the system may allow less
_IP_MULTICAST_ALL = 49
_ADVICE = "is the board on, in the same network, on the same group, port and interface, with the same key?"


class _UdpLink(DatagramLink):
    def _require_open(self) -> None:
        if self._wire.fileno() < 0:
            raise OSError(errno.EBADF, "closed")

    def _out(self, data: bytes) -> list[tuple[bytes, int]]:
        if data.find(b"\0", 1) == len(data) - 1:
            return [(data, len(data))]
        return [(b"\0" + run + b"\0", len(run) + 2) for run in data.split(b"\0") if run]


class UdpHost(_UdpLink):
    """The host's end. `board` is where the board speaks from; None where only the key tells.

    Attributes:
        strangers: datagrams dropped because they came from somebody else.
        unheard: of these, those that were not from the board's address.
    """

    def __init__(
        self,
        wire: socket.socket,
        name: str,
        group: Address,
        board: Address | None,
        session: PlainHost | KeyedHost,
        claim: Claim,
    ) -> None:
        super().__init__(wire, name, SERIAL, claim, _ADVICE)
        self._group = group
        self._board = board
        self._session = session
        self.unheard = 0

    @property
    def strangers(self) -> int:
        return self.unheard + self._session.refused

    @property
    def plain(self) -> tuple[Address, Address] | None:
        """Where the board speaks from and where it hears, if a datagram is a frame and nothing else."""
        if self._board is None or not isinstance(self._session, PlainHost):
            return None
        return self._board, self._group

    def close(self) -> None:
        """Leave the board to the next host, and close the socket; a second call does nothing."""
        if self._wire.fileno() >= 0 and (last := self._session.leave()) is not None:
            with suppress(OSError):
                self._wire.sendto(last, self._group)
        super().close()

    def _put(self, datagram: bytes) -> None:
        self._require_open()
        sealed = self._session.seal(datagram)
        if sealed is not None:  # nothing but HELLO is said before there is a session
            self._wire.sendto(sealed, self._group)

    def _in(self, datagram: bytes, source: Source) -> bytes | None:
        if self._board is not None and source != self._board:
            self.unheard += 1
            return None
        frame, reply, _ = self._session.heard(datagram)
        if reply:
            with suppress(OSError):  # HELLO is said again, and with it this
                self._wire.sendto(reply, self._group)
        if self._session.busy:
            self.advice = "another host is using this board; end it there"
        return frame


class UdpBoard(_UdpLink):
    """The board's end: hears what is sent to the group, answers by another socket to its one peer.

    Attributes:
        strangers: datagrams dropped because they came from somebody else.
    """

    def __init__(
        self, hears: socket.socket, speaks: socket.socket, name: str, session: PlainBoard | KeyedBoard, claim: Claim
    ) -> None:
        super().__init__(hears, name, SERIAL, claim, _ADVICE)
        speaks.setblocking(False)
        self._speaks = speaks
        self._session = session
        self._peer = Peer()

    @property
    def strangers(self) -> int:
        return self._session.refused

    def close(self) -> None:
        self._speaks.close()
        super().close()

    def _put(self, datagram: bytes) -> None:
        self._require_open()
        peer = self._peer.address
        sealed = None if peer is None else self._session.seal(datagram)
        if peer is not None and sealed is not None:  # or nobody waits for it
            self._speaks.sendto(sealed, peer)

    def _in(self, datagram: bytes, source: Source) -> bytes | None:
        peer = self._peer
        frame, reply, opened = self._session.heard(datagram, from_peer=source == peer.address, taken=peer.taken(source))
        if reply:
            with suppress(OSError):
                self._speaks.sendto(reply, source)
        if frame is None:
            return None
        if not frame:
            peer.leave()
            return None
        if opened or source == peer.address:
            peer.heard(source)
        return frame


def open_udp(link: UdpGroup, sender: Sender) -> UdpHost | UdpBoard:
    """A link to a multicast group; its `interface` is the address of the network interface to use, by default that of
    the loopback; its `key` names a key file, without which the link stays on the loopback.

    Raises:
        LinkError: not a multicast group and port, no such interface, no key for it, a bad key file, or another host
            (for a board: another board) is there.
    """
    name = link.url
    (group, port), local = link.address, link.local
    secret = None if link.key is None else read_key(Path(link.key).expanduser())
    if secret is None and not ipaddress.IPv4Address(local).is_loopback:
        raise LinkError(
            f"{name}: off this machine anybody could command the board; make a key with `hil key FILE`, give it to "
            "the board, and add &key=FILE"
        )
    claim = Claim(
        f"udp/{group}:{port}/{sender}",
        name,
        "another host on this machine has this link; end it there"
        if sender == HOST
        else "another board serves this group and port; take another port",
    )
    try:
        if sender == HOST:
            board = (local, port) if secret is None else None
            session = PlainHost() if secret is None else KeyedHost(secret)
            return UdpHost(_bound(name, local, (local, 0), None), name, (group, port), board, session, claim)
        hears = _bound(name, local, (group, port), group)
        try:
            speaks = _bound(name, local, (local, port), None)
        except LinkError:
            hears.close()
            raise
        return UdpBoard(hears, speaks, name, PlainBoard() if secret is None else KeyedBoard(secret), claim)
    except LinkError:
        claim.release()
        raise


def _bound(name: str, local: str, address: Address, group: str | None) -> socket.socket:
    """A socket that nobody else can have, which sends to groups by the interface `local`; with a `group`, it hears what
    is sent there on that interface."""
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        wire.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)  # not what other programs have joined
        wire.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)  # no further than this network
        wire.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(local))
        wire.bind(address)
        if group is not None:
            joined = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton(local))
            wire.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, joined)
    except OSError as error:
        wire.close()
        raise LinkError(f"{name}: {_remedy(error, local, address[1])}") from None
    return wire


def _remedy(error: OSError, local: str, port: int) -> str:
    if error.errno in (errno.ENODEV, errno.ENETUNREACH, errno.EADDRNOTAVAIL):
        return f"no network interface has the address {local}; see `ip address`"
    if error.errno == errno.EADDRINUSE:
        return f"another program has port {port}; end it, or take another port"
    return str(error.strerror or error)
