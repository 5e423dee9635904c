"""What a Linux CAN link asks of the kernel and makes of its answers, with a socket that answers as linux/can.h,
linux/can/raw.h, linux/can/error.h, linux/if_arp.h and linux/sockios.h say. `make test-vcan` asks a kernel itself.
"""

import errno
import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.wire import can_link
from hil.wire.can_format import CanFormat
from hil.wire.can_link import CanLink
from hil.wire.claim import Claim
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.frame_format import BOARD, HOST
from hil.wire.links import open_board_link, open_link
from hil.wire.messages import Hello, Safe
from hil.wire.stream import Transmitter
from tests.wire.sockets import Sockets

EFF, RTR, ERR = 1 << 31, 1 << 30, 1 << 29
HELLO = Transmitter(CanFormat(2, HOST)).encode(Hello(1, 2), 0)
SAFE = Transmitter(CanFormat(2, HOST)).encode(Safe(1), 0)


class Interface:
    """An interface, and the raw socket that is opened on it: one end of a pair, so that it can be waited for."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.name, self.kind, self.mtu, self.flags = "can0", 280, 72, 1
        self.said = b""  # frame that is on the bus while a host listens
        self.options: list[tuple[int, int, Any]] = []
        self.bound: Any = None
        self.ends: list[socket.socket] = []
        self.opened = self.closed = 0
        monkeypatch.setattr(can_link, "socket", Sockets(self._socket))
        monkeypatch.setattr(can_link.fcntl, "ioctl", self._ioctl)
        monkeypatch.setattr(can_link, "interfaces", lambda: ["can0", "vcan3"])

    def _socket(self, family: int, kind: int, protocol: int = 0) -> Any:
        assert (family, kind, protocol) == (socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        interface = self
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.ends.append(far)
        self.opened += 1
        if self.said:
            far.send(self.said)

        class Wire(socket.socket):
            def setsockopt(self, level: int, option: int, value: Any) -> None:
                interface.options.append((level, option, value))

            def bind(self, address: Any) -> None:
                interface.bound = address

            def close(self) -> None:
                if self.fileno() >= 0:
                    interface.closed += 1
                super().close()

        return Wire(fileno=near.detach())

    def _ioctl(self, wire: Any, what: int, asked: bytes) -> bytes:
        assert len(asked) == 32
        assert not any(asked[16:])
        if asked[:16].rstrip(b"\0").decode() != self.name:
            raise OSError(errno.ENODEV, "No such device")
        answer = {0x8913: ("=H", self.flags), 0x8921: ("=i", self.mtu), 0x8927: ("=H", self.kind)}[what]
        return asked[:16] + struct.pack(*answer).ljust(16, b"\xee")


@pytest.fixture
def interface(monkeypatch: pytest.MonkeyPatch) -> Iterator[Interface]:
    monkeypatch.setattr(can_link, "Claim", lambda what, *rest: Claim(f"test-{os.getpid()}/{what}", *rest))
    found = Interface(monkeypatch)
    yield found
    for end in found.ends:
        end.close()


def filters(interface: Interface) -> list[bytes]:
    return [value for level, option, value in interface.options if (level, option) == (101, 1)]


@pytest.mark.parametrize("node", [0, 2, 7])
def test_a_host_listens_for_another_one_and_then_hears_its_board_alone(interface: Interface, node: int) -> None:
    """CAN_RAW_FILTER, (identifier, mask): whatever the type, of one node and one end; no extended or remote frame."""
    link = open_link(f"can:can0?node={node}" if node else "can:can0")
    mask = EFF | RTR | 0xF
    assert filters(interface) == [
        b"", struct.pack("=II", node << 1, mask), struct.pack("=II", node << 1 | 1, mask)
    ]  # fmt: skip
    assert interface.bound == ("can0",)
    assert link.name == (f"can:can0?node={node}" if node else "can:can0")
    assert link.advice == f"is the board on, is it node {node}, and is the bit timing right?"
    link.close()
    assert interface.closed == interface.opened == 1


def test_a_board_hears_its_hosts(interface: Interface) -> None:
    link = open_board_link("can:can0?node=2")
    assert filters(interface)[-1] == struct.pack("=II", 2 << 1, EFF | RTR | 0xF)
    with pytest.raises(LinkError, match=r"another board serves node 2 here; .* can:can0\?node=3"):
        open_board_link("can:can0?node=2")
    link.close()
    assert interface.closed == interface.opened == 2


def test_the_socket_is_set_up_for_fd_errors_and_short_queues(interface: Interface) -> None:
    """CAN_RAW_FD_FRAMES 5, CAN_RAW_ERR_FILTER 2 for lost arbitration of nothing but: no acknowledgement, bus off."""
    open_board_link("can:can0").close()
    assert (101, 5, 1) in interface.options
    assert (101, 2, 0x20 | 0x40) in interface.options
    assert (socket.SOL_SOCKET, socket.SO_SNDBUF, 0) in interface.options
    assert (socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 2**20) in interface.options
    assert filters(interface)[0] == b""


def test_a_second_host_is_refused_and_the_first_stays(interface: Interface) -> None:
    first = open_link("can:can0")
    with pytest.raises(LinkError, match="another host on this machine has this link; end it there"):
        open_link("can:can0")
    assert (interface.opened, interface.closed) == (2, 1)
    first.close()
    open_link("can:can0").close()


def test_a_host_elsewhere_is_noticed_and_an_error_frame_is_none(interface: Interface) -> None:
    interface.said = HELLO
    for _ in range(2):  # what was claimed is free again
        with pytest.raises(LinkError, match=r"can:can0\?node=2: another host on this bus is using node 2; end it"):
            open_link("can:can0?node=2")
    assert interface.closed == interface.opened == 2
    open_board_link("can:can0?node=2").close()  # a board does not mind
    interface.said = struct.pack("=IB", ERR | 0x20, 8).ljust(16, b"\0")
    open_link("can:can0?node=2").close()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"name": "can1"}, "no such CAN interface; plug it in or name another one (found: can0, vcan3)"),
        ({"kind": 1}, "can0 is not a CAN interface (found: can0, vcan3)"),
        (
            {"mtu": 16},
            "can0 has no CAN FD (its MTU is 16): sudo ip link set can0 down && sudo ip link set can0 up type can "
            "bitrate 1000000 dbitrate 8000000 fd on",
        ),
        ({"mtu": 71}, "can0 has no CAN FD (its MTU is 71)"),
        (
            {"flags": 0xFFFE},
            "can0 is down: sudo ip link set can0 up type can bitrate 1000000 dbitrate 8000000 fd on",
        ),
    ],
)
def test_what_is_wrong_with_an_interface_is_told(interface: Interface, wrong: dict[str, Any], words: str) -> None:
    for name, value in wrong.items():
        setattr(interface, name, value)
    with pytest.raises(LinkError) as told:
        open_link("can:can0")
    assert words in str(told.value)
    assert str(told.value).startswith("can:can0: ")
    assert interface.closed == interface.opened == 1


def test_a_virtual_interface_has_no_bit_timing(interface: Interface) -> None:
    interface.name, interface.flags = "vcan3", 0
    with pytest.raises(LinkError, match=r"sudo ip link set vcan3 mtu 72 up$"):
        open_link("can:vcan3")
    with pytest.raises(LinkError, match="no such CAN interface"):
        open_link("can:" + 40 * "a")


def test_an_interface_that_is_up_among_other_things_is_up(interface: Interface) -> None:
    interface.flags, interface.mtu = 0x43, 2000
    open_link("can:can0").close()


@pytest.mark.parametrize(
    ("number", "words"),
    [(errno.EAFNOSUPPORT, "this kernel has no CAN; load it"), (errno.EPERM, "Operation not permitted")],
)
def test_a_kernel_that_gives_no_socket(monkeypatch: pytest.MonkeyPatch, number: int, words: str) -> None:
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(can_link, "socket", Sockets(refuse))
    with pytest.raises(LinkError, match=f"can:can0: {words}"):
        open_link("can:can0")


# -------------------------------------------------------------------------------------------------------------- frames


@pytest.fixture
def ends() -> Iterator[tuple[CanLink, socket.socket]]:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    link = CanLink(near, "can:can0?node=2", 2, HOST, Claim(f"test-can-{os.getpid()}", "can:can0", "end it"))
    yield link, far
    link.close()
    far.close()


def test_a_classic_frame_goes_as_16_bytes_and_one_of_fd_as_72(ends: tuple[CanLink, socket.socket]) -> None:
    link, far = ends
    assert link.offer(HELLO + SAFE + HELLO) == 3 * 72
    assert [far.recv(100), far.recv(100), far.recv(100)] == [HELLO, SAFE[:16], HELLO]
    assert SAFE[16:] == bytes(56)


def test_what_comes_is_filled_up_to_a_record(ends: tuple[CanLink, socket.socket]) -> None:
    link, far = ends
    far.send(SAFE[:16])
    far.send(HELLO)
    assert link.receive(1.0) == SAFE + HELLO


def error_frame(what: int) -> bytes:
    return struct.pack("=IB", ERR | what, 8).ljust(16, b"\0")


def test_frames_that_nobody_acknowledges_are_what_is_looked_at_first(ends: tuple[CanLink, socket.socket]) -> None:
    link, far = ends
    for frame in (error_frame(0x04), struct.pack("=IB", 0x20, 1).ljust(16, b"\0")):
        far.send(frame)
        assert len(link.receive(1.0)) == 72
        assert "is it node 2" in link.advice
    far.send(error_frame(0x20))
    assert CanFormat(2, HOST).decoder().feed(link.receive(1.0)) == []  # it is no frame of the board
    assert link.advice.startswith("no node acknowledges a frame; check the board's supply")


def test_a_controller_that_is_off_the_bus_ends_it(ends: tuple[CanLink, socket.socket]) -> None:
    link, far = ends
    far.send(error_frame(0x60))
    with pytest.raises(LinkClosed, match=r"off the bus; .* then `sudo ip link set can0 type can restart`"):
        link.receive(1.0)


def test_the_interfaces_of_a_machine_are_those_of_arphrd_can(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, kind in (("vcan0", "280\n"), ("can1", "280\n"), ("lo", "772\n"), ("odd", "x")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(kind)
    monkeypatch.setattr(can_link, "Path", lambda _: tmp_path)
    (tmp_path / "odd" / "type").unlink()
    assert can_link.interfaces() == ["can1", "vcan0"]


def test_the_ends_are_numbered_as_in_an_identifier() -> None:
    assert (HOST, BOARD) == (0, 1)
    assert can_link.LISTEN_S == 0.05
