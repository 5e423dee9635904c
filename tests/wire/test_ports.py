"""How a serial port and the board's end of a pty are opened and given back, call by call (docs/wire.md, Links)."""

import errno
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import serial

from hil.wire import serial_link
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.fd_link import FdLink
from hil.wire.links import open_link
from hil.wire.pty_link import PtyLink, open_pty
from hil.wire.serial_link import open_serial


class Port:
    """In the place of pyserial's: how it was opened, and what it was told then."""

    opened: "list[Port]" = []  # noqa: RUF012

    def __init__(self, *place: Any, **how: Any) -> None:
        self.place, self.how, self.low_latency, self.closes = place, how, None, 0
        self.read_end, self.write_end = os.pipe()
        Port.opened.append(self)

    def fileno(self) -> int:
        return self.read_end

    def set_low_latency_mode(self, on: bool) -> None:
        self.low_latency = on

    def close(self) -> None:
        self.closes += 1
        if self.closes == 1:
            os.close(self.read_end)
            os.close(self.write_end)


@pytest.fixture
def ports(monkeypatch: pytest.MonkeyPatch) -> list[Port]:
    monkeypatch.setattr(serial, "Serial", Port)
    monkeypatch.setattr(Port, "opened", [])
    return Port.opened


def test_a_port_is_opened_raw_exclusively_and_quick(ports: list[Port]) -> None:
    """3 MBd unless the link's name says otherwise; VMIN = 1, which an inter-byte timeout of 0 sets in pyserial."""
    for url, baud in (("serial:/dev/ttyX", 3_000_000), ("serial:/dev/ttyX?baud=115200", 115200)):
        link = open_link(url)
        port = ports[-1]
        assert port.place == ("/dev/ttyX", baud)
        assert port.how == {"timeout": 0, "inter_byte_timeout": 0, "exclusive": True}
        assert port.low_latency is True
        assert link.fileno() == port.read_end
        link.close()
        assert (link.fileno(), port.closes) == (-1, 1)
    open_serial("/dev/ttyY").close()
    assert ports[-1].place == ("/dev/ttyY", 3_000_000)


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EAGAIN, "in use by another program"),
        (errno.EBUSY, "in use by another program"),
        (errno.ENOENT, "no such port; connect the board or name another port (found: /dev/ttyA, /dev/ttyB)"),
        (errno.ENXIO, "no such port"),
        (errno.ENODEV, "no such port"),
        (errno.EACCES, "no permission"),
    ],
)
def test_each_way_a_port_fails_has_its_remedy(monkeypatch: pytest.MonkeyPatch, number: int, words: str) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise serial.SerialException(number, "")

    found = [SimpleNamespace(device=name) for name in ("/dev/ttyB", "/dev/ttyA")]
    monkeypatch.setattr(serial, "Serial", fail)
    monkeypatch.setattr(serial_link.list_ports, "comports", lambda: found)
    with pytest.raises(LinkError) as told:
        open_serial("/dev/ttyX")
    assert words in str(told.value)
    found.clear()
    if number == errno.ENOENT:
        with pytest.raises(LinkError, match=r"\(found: none\)"):
            open_serial("/dev/ttyX")


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.parametrize("number", [errno.EIO, errno.ENXIO, errno.ENODEV, errno.EPIPE, errno.EBADF])
def test_each_way_to_hang_up_is_one(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    """And what is none is told as the system does."""
    reading, writing = os.pipe()
    os.write(writing, b"a")
    link = FdLink(reading, "pipe")

    def fail(*_: Any) -> int:
        raise OSError(number, "a strange thing")

    with monkeypatch.context() as patched:
        patched.setattr(os, "read", fail)
        patched.setattr(os, "write", fail)
        for attempt in (lambda: link.receive(0.1), lambda: link.offer(b"a")):
            with pytest.raises(LinkClosed, match="pipe: the other end hung up"):
                attempt()
        number = errno.ENOMEM
        with pytest.raises(LinkClosed, match=f"pipe: {os.strerror(number)}"):
            link.offer(b"a")
    link.close()
    os.close(writing)


@pytest.fixture
def board() -> PtyLink:
    link = open_pty()
    yield link
    link.close()


def test_a_pty_keeps_its_own_end_open_until_a_host_has_spoken(board: PtyLink) -> None:
    """Without it the kernel would tell a hang-up before anybody was there; with it for ever, none at all."""
    assert (board.drop_when_full, board.dropped_bytes, board.url) == (False, 0, f"serial:{board.path}")
    before = descriptors()
    host = open_serial(board.path)
    host.send(b"hi")
    assert board.receive(5.0) == b"hi"
    host.close()
    assert descriptors() == before - 1
    with pytest.raises(LinkClosed, match="hung up"):
        board.receive(5.0)
    board.await_host()
    board.await_host()
    assert descriptors() == before
    assert board.receive(0.0) == b""
    board.close()
    assert descriptors() == before - 2


def test_a_new_host_hears_nothing_that_was_meant_for_the_last(board: PtyLink) -> None:
    """The terminal keeps what a host leaves unread; the next one, if it does not flush on opening as pyserial does,
    would take it for its own.
    """
    first = open_serial(board.path)
    first.send(b"hi")
    assert board.receive(5.0) == b"hi"
    board.offer(b"for the first")
    first.close()
    with pytest.raises(LinkClosed, match="hung up"):
        board.receive(5.0)
    board.await_host()
    second = os.open(board.path, os.O_RDWR | os.O_NOCTTY)
    board.offer(b"for the second")
    heard = os.read(second, 100)
    os.close(second)
    assert heard == b"for the second"
