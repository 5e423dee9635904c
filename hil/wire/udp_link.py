"""UDP multicast: a datagram per frame, framed as on a serial line, so that checksum and sequence are checked.

A host sends to the group's port, a board to the next one; anybody may listen to either.
"""

import errno
import ipaddress
import socket
import struct
import time

from hil.wire.claim import Claim
from hil.wire.datagram_link import DatagramLink
from hil.wire.errors import LinkError
from hil.wire.frame_format import HOST, Sender
from hil.wire.serial_format import SERIAL

LISTEN_S = 0.05
"""How long a host listens for another one before it speaks."""

_BUFFER = 1 << 22  # bytes to hold while a reader is away; the system may allow less
_IP_MULTICAST_ALL = 49


class UdpLink(DatagramLink):
    """One end of the conversation."""

    def __init__(self, wire: socket.socket, name: str, target: tuple[str, int], claim: Claim) -> None:
        super().__init__(wire, name, SERIAL, claim, "is the board on, in the same network, on the same group and port?")
        self._target = target

    def _put(self, datagram: bytes) -> None:
        self._wire.sendto(datagram, self._target)

    def _out(self, data: bytes) -> list[tuple[bytes, int]]:
        if data.find(b"\0", 1) == len(data) - 1:
            return [(data, len(data))]
        return [(b"\0" + run + b"\0", len(run) + 2) for run in data.split(b"\0") if run]

    def _in(self, datagram: bytes) -> bytes:
        return datagram


def open_udp(place: str, interface: str | None, sender: Sender) -> UdpLink:
    """A link by GROUP:PORT; `interface` is the address of the network interface to use, by default the system's choice.

    Raises:
        LinkError: not a multicast group and port, no such interface, or another host (for a board: another board) is
            there.
    """
    name = f"udp:{place}" + (f"?interface={interface}" if interface else "")
    group, port = _parse(place, name)
    hears, speaks = (port + 1, port) if sender == HOST else (port, port + 1)
    claim = Claim(
        f"udp/{group}:{port}/{sender}",
        name,
        "another host on this machine has this link; end it there"
        if sender == HOST
        else "another board serves this group and port; take another port",
    )
    try:
        if sender == HOST:
            _require_silence(name, group, port, interface)
        return UdpLink(_join(name, group, hears, interface), name, (group, speaks), claim)
    except LinkError:
        claim.release()
        raise


def _parse(place: str, name: str) -> tuple[str, int]:
    group, _, port = place.rpartition(":")
    try:
        if ipaddress.IPv4Address(group).is_multicast and 0 < int(port) < 65535:
            return group, int(port)
    except ValueError:
        pass
    raise LinkError(f"{name}: expected a multicast group and a port, such as udp:239.0.0.1:4242")


def _join(name: str, group: str, port: int, interface: str | None) -> socket.socket:
    """A socket that hears what is sent to the group at this port."""
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # others may listen too
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        wire.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
        wire.bind((group, port))
        local = socket.inet_aton(interface or "0.0.0.0")
        wire.setsockopt(
            socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, struct.pack("4s4s", socket.inet_aton(group), local)
        )
        if interface:
            wire.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, local)
    except OSError as error:
        wire.close()
        raise LinkError(f"{name}: {_cure(error, interface)}") from None
    return wire


def _cure(error: OSError, interface: str | None) -> str:
    if error.errno in (errno.ENODEV, errno.ENETUNREACH, errno.EADDRNOTAVAIL):
        if interface:
            return f"no network interface has the address {interface}; see `ip address`"
        return "no network to send to; name an interface's address, such as ?interface=127.0.0.1"
    return str(error.strerror or error)


def _require_silence(name: str, group: str, port: int, interface: str | None) -> None:
    """Raise LinkError if a host on another machine is speaking."""
    with _join(name, group, port, interface) as others:
        others.settimeout(LISTEN_S)
        until = time.monotonic() + LISTEN_S
        try:
            while time.monotonic() < until:
                _, (address, _) = others.recvfrom(65536)
                raise LinkError(f"{name}: the host at {address} is using this board; end it there")
        except TimeoutError:
            return
