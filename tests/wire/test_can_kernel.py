"""What a Linux CAN link makes of frames and of a kernel's answers, as linux/can.h and linux/can/error.h say; tests/vcan
asks a kernel itself.
"""

import errno
import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.wire import can_link
from hil.wire.can_format import CanFormat
from hil.wire.can_link import CanLink
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.frame_format import HOST
from hil.wire.link import Claim
from hil.wire.links import open_link
from hil.wire.messages import Hello, Safe
from hil.wire.stream import Transmitter
from tests.wire.sockets import Sockets

EFF, RTR, ERR = 1 << 31, 1 << 30, 1 << 29
HELLO = Transmitter(CanFormat(2, HOST)).encode(Hello(1, 2), 0)
SAFE = Transmitter(CanFormat(2, HOST)).encode(Safe(1), 0)


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
