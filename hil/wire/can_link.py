"""Linux CAN interfaces by a raw SocketCAN socket; python-can, for every other adapter, costs several times as much.

The kernel passes `struct canfd_frame` for CAN FD and the shorter `struct can_frame` for classic frames; up to the
length of their data they are the same, so a classic frame becomes a record by being filled up with zeros.
"""

import errno
import fcntl
import select
import socket
import struct
from contextlib import suppress
from pathlib import Path

from hil.wire.can_format import CAN, FDF, RECORD_SIZE, CanFormat
from hil.wire.datagram_link import DatagramLink, Source
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.frame_format import BOARD, HOST, Sender
from hil.wire.link import Claim

LISTEN_S = 0.05
"""How long a host listens for another one before it speaks."""

_BUFFER = 1 << 22  # bytes to hold while a reader is away; the system may allow less

CLASSIC_SIZE = 16
"""Bytes of `struct can_frame`, and the MTU of an interface without CAN FD."""

# From linux/can.h, linux/can/raw.h, linux/can/error.h, linux/if_arp.h and linux/sockios.h.
_EFF_FLAG, _RTR_FLAG, _ERR_FLAG = 0x80000000, 0x40000000, 0x20000000
_ERR_ACK, _ERR_BUSOFF = 0x20, 0x40
_CAN_RAW_ERR_FILTER = 2
_ARPHRD_CAN = 280
_SIOCGIFFLAGS, _SIOCGIFMTU, _SIOCGIFHWADDR = 0x8913, 0x8921, 0x8927
_IFF_UP = 0x1
_HEARD = struct.Struct("=IB")
_FLAGS_AT = 5


class CanLink(DatagramLink):
    """One end of the conversation on one interface.

    Attributes:
        advice: what to look at when nothing answers; knows when frames are not even acknowledged.
    """

    def __init__(self, wire: socket.socket, name: str, node: int, sender: Sender, claim: Claim) -> None:
        advice = f"is the board on, is it node {node}, and is the bit timing right?"
        super().__init__(wire, name, CanFormat(node, sender), claim, advice)

    def _put(self, datagram: bytes) -> None:
        self._wire.send(datagram)

    def _out(self, data: bytes) -> list[tuple[bytes, int]]:
        return [
            (data[at : at + (RECORD_SIZE if data[at + _FLAGS_AT] & FDF else CLASSIC_SIZE)], RECORD_SIZE)
            for at in range(0, len(data), RECORD_SIZE)
        ]

    def _in(self, datagram: bytes, source: Source) -> bytes:
        if len(datagram) == RECORD_SIZE:
            return datagram
        identifier, _ = _HEARD.unpack_from(datagram)
        if identifier & _ERR_FLAG:
            self.trouble(identifier)
        return datagram.ljust(RECORD_SIZE, b"\0")

    def trouble(self, identifier: int) -> None:
        """An error frame, which the driver made. Raises LinkClosed where the bus is gone."""
        if identifier & _ERR_BUSOFF:
            raise LinkClosed(
                f"{self.name}: the controller is off the bus; check wiring, termination and bit timing, then "
                f"`sudo ip link set {self.name.partition(':')[2].partition('?')[0]} type can restart`"
            )
        if identifier & _ERR_ACK:
            self.advice = "no node acknowledges a frame; check the board's supply, wiring, termination and bit timing"


def open_can(interface: str, node: int, sender: Sender) -> CanLink:
    """A link to, or of, the board that is `node` on a CAN interface such as can0.

    Raises:
        LinkError: no CAN in this kernel, no such interface, it is down or without CAN FD, or another host (for a
            board: another board) is there.
    """
    name = f"can:{interface}" + (f"?node={node}" if node else "")
    wire = _open(name, interface)
    try:
        claim = Claim(
            f"can/{interface}/{node}/{sender}",
            name,
            "another host on this machine has this link; end it there"
            if sender == HOST
            else f"another board serves node {node} here; take another node, such as can:{interface}?node={node + 1}",
        )
        try:
            if sender == HOST:
                _require_silence(wire, name, node)
            _hear(wire, node, BOARD if sender == HOST else HOST)
            return CanLink(wire, name, node, sender, claim)
        except LinkError:
            claim.release()
            raise
    except LinkError:
        wire.close()
        raise


def interfaces() -> list[str]:
    """CAN interfaces of this machine."""
    found = []
    for kind in Path("/sys/class/net").glob("*/type"):
        with suppress(OSError):
            if int(kind.read_text()) == _ARPHRD_CAN:
                found.append(kind.parent.name)
    return sorted(found)


def _open(name: str, interface: str) -> socket.socket:
    """A raw socket on the interface, once it has been looked at."""
    try:
        wire = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    except OSError as error:
        if error.errno == errno.EAFNOSUPPORT:
            remedy = "this kernel has no CAN; load it (sudo modprobe can-raw), or use an adapter: can:INTERFACE:CHANNEL"
        else:
            remedy = str(error.strerror)
        raise LinkError(f"{name}: {remedy}") from None
    try:
        _look_at(wire, name, interface)
        # Of an adapter's queue, ten frames by default, the kernel does not tell when it has room again; of the socket's
        # own buffer it does. The smallest one is less than the queue.
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 0)
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        wire.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        wire.setsockopt(socket.SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, _ERR_ACK | _ERR_BUSOFF)
        wire.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")  # deaf until it is known what to hear
        wire.bind((interface,))
    except OSError as error:
        wire.close()
        raise LinkError(error if isinstance(error, LinkError) else f"{name}: {error.strerror}") from None
    return wire


def _look_at(wire: socket.socket, name: str, interface: str) -> None:
    """Raise LinkError unless the interface is a CAN interface, up, with CAN FD."""

    def ask(what: int) -> int:
        answer = fcntl.ioctl(wire, what, struct.pack("16si12x", interface.encode(), 0))
        return int(struct.unpack_from("=i" if what == _SIOCGIFMTU else "=H", answer, 16)[0])

    try:
        kind, mtu, flags = (ask(what) for what in (_SIOCGIFHWADDR, _SIOCGIFMTU, _SIOCGIFFLAGS))
    except (OSError, struct.error):
        found = ", ".join(interfaces()) or "none"
        raise LinkError(f"{name}: no such CAN interface; plug it in or name another one (found: {found})") from None
    if kind != _ARPHRD_CAN:
        raise LinkError(f"{name}: {interface} is not a CAN interface (found: {', '.join(interfaces()) or 'none'})")
    timing = (
        "mtu 72 up" if interface.startswith("vcan") else "up type can bitrate 1000000 dbitrate 8000000 fd on"
    )  # a virtual one has no bit timing
    if mtu < RECORD_SIZE:
        raise LinkError(
            f"{name}: {interface} has no CAN FD (its MTU is {mtu}): "
            f"sudo ip link set {interface} down && sudo ip link set {interface} {timing}"
        )
    if not flags & _IFF_UP:
        raise LinkError(f"{name}: {interface} is down: sudo ip link set {interface} {timing}")


def _hear(wire: socket.socket, node: int, sender: Sender) -> None:
    """Let through what one end of one node sends, whatever its type."""
    identifier = CAN.identifier(0, node, sender)
    mask = _EFF_FLAG | _RTR_FLAG | CAN.identifier(0, CAN.nodes - 1, 1)
    wire.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, struct.pack("=II", identifier, mask))


def _require_silence(wire: socket.socket, name: str, node: int) -> None:
    """Raise LinkError if another host on the bus is speaking to this node."""
    _hear(wire, node, HOST)
    if select.select([wire], (), (), LISTEN_S)[0]:
        identifier, _ = _HEARD.unpack_from(wire.recv(RECORD_SIZE))
        if not identifier & _ERR_FLAG:
            raise LinkError(f"{name}: another host on this bus is using node {node}; end it there")
