"""Every link: one conformance class, then what is particular to each."""

import errno
import os
import termios
import threading
from contextlib import suppress
from importlib.metadata import EntryPoint

import pytest
import serial

from hil.wire import inproc
from hil.wire.client import arm, connect
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.inproc import InprocLink, open_inproc
from hil.wire.link_name import Emulated
from hil.wire.links import open_link
from hil.wire.pty_link import PtyLink, open_pty
from hil.wire.serial_link import open_serial

from .board import SmallBoard

ALL_BYTES = bytes(range(256))
WAIT_S = 5.0


def read(link, size: int) -> bytes:
    data = b""
    while len(data) < size:
        chunk = link.receive(WAIT_S)
        assert chunk, f"only {len(data)} of {size} bytes came"
        data += chunk
    return data


class Echo:
    """A board that returns what it gets."""

    def __init__(self) -> None:
        self.closes = 0

    def exchange(self, data: bytes) -> bytes:
        return data

    def close(self) -> None:
        self.closes += 1


class LinkConformance:
    """What holds for every link, seen from the host; the peer returns what it gets."""

    @pytest.fixture
    def link(self):
        raise NotImplementedError

    def test_every_byte_passes_unchanged(self, link):
        link.send(ALL_BYTES)
        assert read(link, 256) == ALL_BYTES

    def test_nothing_arrives_by_itself(self, link):
        assert link.receive(0.0) == b""

    def test_bytes_come_once(self, link):
        link.send(b"once")
        assert read(link, 4) == b"once"
        assert link.receive(0.0) == b""

    def test_more_than_a_queue_passes(self, link):
        """A pty holds 16.9 kB."""
        data = os.urandom(100_000)
        for start in range(0, len(data), 10_000):
            part = data[start : start + 10_000]
            link.send(part)
            assert read(link, len(part)) == part

    def test_descriptor_to_wait_on(self, link):
        descriptor = link.fileno()
        assert descriptor is None or descriptor >= 0

    def test_name_is_short(self, link):
        assert link.name
        assert "\n" not in link.name

    def test_after_close(self, link):
        link.close()
        link.close()
        with pytest.raises(LinkClosed, match="closed"):
            link.send(b"1")
        with pytest.raises(LinkClosed, match="closed"):
            link.receive(0.0)


class TestInproc(LinkConformance):
    @pytest.fixture
    def link(self):
        return InprocLink(Echo())

    def test_closes_the_board_once(self):
        board = Echo()
        link = InprocLink(board)
        link.close()
        link.close()
        assert board.closes == 1

    def test_answers_pile_up(self):
        link = InprocLink(Echo())
        link.send(b"one ")
        link.send(b"two")
        assert link.receive(None) == b"one two"


class TestSerialOnPty(LinkConformance):
    @pytest.fixture
    def link(self):
        board = open_pty()
        host = open_serial(board.path)
        done = threading.Event()
        echo = threading.Thread(target=self.echo, args=(board, done))
        echo.start()
        yield host
        host.close()
        done.set()
        echo.join(WAIT_S)
        board.close()
        assert not echo.is_alive()

    @staticmethod
    def echo(board: PtyLink, done: threading.Event) -> None:
        with suppress(LinkClosed):
            while not done.is_set():
                board.send(board.receive(0.02))


@pytest.fixture
def board():
    link = open_pty()
    yield link
    link.close()


def hang_up(board: PtyLink, words: bytes = b"hello") -> None:
    host = open_serial(board.path)
    host.send(words)
    assert read(board, len(words)) == words
    host.close()


def test_pty_is_raw_before_anybody_opens_it(board):
    fd = os.open(board.path, os.O_RDWR | os.O_NOCTTY)
    flags = termios.tcgetattr(fd)
    os.close(fd)
    assert flags[1] & termios.OPOST == 0
    assert flags[3] & (termios.ECHO | termios.ICANON | termios.ISIG) == 0


def test_pty_does_not_return_what_the_board_says(board):
    board.send(b"anybody?\r\n\x03\x04")
    assert board.receive(0.0) == b""


def test_pty_waits_for_its_first_host(board):
    assert board.receive(0.0) == b""
    host = open_serial(board.path)
    host.send(b"hi")
    assert read(board, 2) == b"hi"
    host.close()


def test_board_hears_the_last_words_and_then_the_hang_up(board):
    host = open_serial(board.path)
    host.send(b"hi")
    assert read(board, 2) == b"hi"
    host.send(b"bye")
    host.close()
    assert read(board, 3) == b"bye"
    for _ in range(2):
        with pytest.raises(LinkClosed, match=f"pty {board.path}: the other end hung up"):
            board.receive(WAIT_S)


def test_another_host_starts_clean(board):
    hang_up(board)
    board.send(b"for nobody")
    board.await_host()
    board.await_host()
    assert board.receive(0.0) == b""
    test_pty_is_raw_before_anybody_opens_it(board)
    host = open_serial(board.path)
    assert host.receive(0.0) == b""
    board.send(ALL_BYTES)
    assert read(host, 256) == ALL_BYTES
    host.send(ALL_BYTES)
    assert read(board, 256) == ALL_BYTES
    host.close()
    with pytest.raises(LinkClosed):
        board.receive(WAIT_S)


def test_a_board_on_wall_time_loses_what_does_not_fit(board):
    host = open_serial(board.path)
    board.drop_when_full = True
    for _ in range(40):
        board.send(b"\x55" * 1000)
    assert 0 < board.dropped_bytes < 40_000
    assert read(host, 40_000 - board.dropped_bytes).count(0x55) == 40_000 - board.dropped_bytes
    assert host.receive(0.0) == b""
    host.close()


def test_a_board_that_waits_for_room_notices_the_hang_up(board):
    host = open_serial(board.path)
    host.send(b"hi")
    assert read(board, 2) == b"hi"
    leave = threading.Timer(0.1, host.close)
    leave.start()
    with pytest.raises(LinkClosed, match="hung up"):
        board.send(bytes(100_000))
    leave.join()


def test_host_notices_that_the_board_is_gone(board):
    host = open_serial(board.path)
    board.close()
    with pytest.raises(LinkClosed, match=f"serial:{board.path}: the other end hung up"):
        host.receive(WAIT_S)
    with pytest.raises(LinkClosed, match="hung up"):
        host.send(b"hello?")
    host.close()


def test_no_pty_left(monkeypatch):
    def openpty():
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "openpty", openpty)
    with pytest.raises(LinkError, match="pty: No space left on device; is /dev/pts mounted"):
        open_pty()


def test_a_port_has_one_user(board):
    host = open_link(f"serial:{board.path}")
    with pytest.raises(LinkError, match=f"serial:{board.path}: the port is in use by another program; close it there"):
        open_link(f"serial:{board.path}")
    host.close()
    open_link(f"serial:{board.path}?baud=115200").close()


def test_a_program_that_looks_at_the_port_for_a_moment_is_waited_for(board):
    """ModemManager probes a port that was just plugged in; a process that was just started holds its parent's."""
    passing = open_link(f"serial:{board.path}")
    leaves = threading.Timer(0.2, passing.close)
    leaves.start()
    open_link(f"serial:{board.path}").close()
    leaves.join(WAIT_S)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        (
            "serial:/dev/no-such-port",
            "serial:/dev/no-such-port: no such port; connect the board or name another",
        ),
        ("serial:/dev/null", "serial:/dev/null: not a serial port; name a terminal device"),
        (f"serial:{__file__}", "not a serial port; name a terminal device"),
        ("serial:/tmp", "serial:/tmp: not a serial port; name a terminal device"),
        ("serial:", "link 'serial:': unknown kind of link; known are serial:…, can:…, udp:…, inproc:…, pty:…"),
        (
            "smoke:signals",
            "link 'smoke:signals': unknown kind of link; known are serial:…, can:…, udp:…, inproc:…, pty:…",
        ),
        ("pty:s-slow", "link 'pty:s-slow': starts a board of its own, and none was started"),
        ("/dev/ttyUSB0", "link '/dev/ttyUSB0': unknown kind of link"),
        ("serial:/dev/ttyUSB0?baud=fast", "bad option; expected serial:PATH or serial:PATH"),
        ("serial:/dev/ttyUSB0?baud=0", "bad option; expected serial:PATH or serial:PATH"),
        ("serial:/dev/ttyUSB0?parity=even", "bad option; expected serial:PATH or serial:PATH"),
    ],
)
def test_links_that_cannot_be_opened_say_why(url, words):
    with pytest.raises(LinkError) as caught:
        open_link(url)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_baud_rate_beyond_the_port(board):
    with pytest.raises(LinkError, match="try another baud rate"):
        open_link(f"serial:{board.path}?baud=1000000000000")


def test_no_permission(monkeypatch):
    def refuse(*_: object, **__: object) -> None:
        raise serial.SerialException(errno.EACCES, "could not open port: Permission denied")

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(LinkError, match="serial:/dev/ttyS0: no permission; add yourself to the group"):
        open_serial("/dev/ttyS0")


def test_inproc_finds_the_installed_emulator(monkeypatch):
    opened = []

    class Entry(EntryPoint):
        def load(self):
            return lambda *arguments, **changes: opened.append((*arguments, changes)) or SmallBoard()

    monkeypatch.setattr(inproc, "entry_points", lambda group: [Entry("small", "m:a", group)])
    link = open_inproc(Emulated("inproc", "a.scenario.toml", 4), truth="truth.arrow", seed=3)
    assert connect(Endpoint(link)).axes == 2
    assert isinstance(open_link("inproc:b.scenario.toml"), InprocLink)
    assert opened == [("a.scenario.toml", "truth.arrow", 3, {"latency_ticks": 4}), ("b.scenario.toml", None, None, {})]


def test_inproc_without_an_emulator(monkeypatch):
    monkeypatch.setattr(inproc, "entry_points", lambda group: [])
    with pytest.raises(LinkError, match=r"inproc:x.toml: no emulator is installed; install .* hil.emulators"):
        open_link("inproc:x.toml")


def test_a_session_over_a_pty(board):
    """Host and board in one thread would wait for each other, so the board gets its own."""

    def serve() -> None:
        small = SmallBoard()
        with suppress(LinkClosed):
            while True:
                board.send(small.exchange(board.receive(None)))

    server = threading.Thread(target=serve)
    server.start()
    endpoint = Endpoint(open_link(f"serial:{board.path}"))
    connect(endpoint, WAIT_S)
    arm(endpoint, WAIT_S)
    rows = []
    while len(rows) < 200:
        for row in endpoint.receive_rows(WAIT_S):
            rows.append(row)
            endpoint.send_drive(row[0] + 1, -7, row[0] + 1)
    assert rows == [(0, 0, 0, 0, 0, 0)] + [(tick, tick, -7, tick, -7, 0) for tick in range(1, 200)]
    assert endpoint.rx.lost == endpoint.rx.bad == endpoint.rx.repeated == 0
    endpoint.close()
    server.join(WAIT_S)
    assert not server.is_alive()


class TestLinksOfOtherPackages:
    """Schemes that an installed package brings, as entry points of the group `hil.links`."""

    @pytest.fixture
    def install(self, tmp_path, monkeypatch):
        def put(name: str, target: str) -> None:
            folder = tmp_path / f"link_{name}-1.0.dist-info"
            folder.mkdir()
            (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: link-{name}\nVersion: 1.0\n")
            (folder / "entry_points.txt").write_text(f"[hil.links]\n{name} = {target}\n")
            monkeypatch.syspath_prepend(str(tmp_path))

        return put

    def test_opens_what_stands_behind_its_scheme(self, install):
        opened = []
        link_of_a_package.open = lambda rest: opened.append(rest) or Opened()
        install("carrier", "tests.wire.test_links:link_of_a_package.open")
        assert isinstance(open_link("carrier:pigeon?speed=3"), Opened)
        assert opened == ["pigeon?speed=3"]

    def test_is_named_where_a_scheme_is_unknown(self, install):
        install("carrier", "tests.wire.test_links:link_of_a_package.open")
        with pytest.raises(LinkError, match="known are serial:…, can:…, udp:…, inproc:…, pty:…, labgrid:…, carrier:…"):
            open_link("smoke:signal")
        with pytest.raises(LinkError, match="unknown kind"):
            open_link("carrier:")

    def test_does_not_take_the_place_of_one_of_the_bench(self, install):
        install("serial", "tests.wire.test_links:link_of_a_package.open")
        with pytest.raises(LinkError, match="serial:/dev/nowhere"):
            open_link("serial:/dev/nowhere")

    def test_that_cannot_be_loaded_is_one_line(self, install):
        install("carrier", "no_such_package:open")
        with pytest.raises(LinkError, match=r"'carrier:…': no_such_package:open cannot be loaded: .*; mend or remove"):
            open_link("carrier:pigeon")


class Opened:
    """A link."""


class link_of_a_package:  # noqa: N801 - a module, in its place
    """What a package brings."""

    @staticmethod
    def open(rest: str) -> Opened:
        raise AssertionError(rest)


def test_a_port_whose_device_goes_while_it_is_opened_is_a_link_error(monkeypatch):
    def gone(*_, **__):
        raise termios.error(errno.EIO, "Input/output error")

    monkeypatch.setattr("hil.wire.serial_link.serial.Serial", gone)
    with pytest.raises(LinkError, match=r"^serial:/dev/ttyACM0: its other end is gone; connect the board again$"):
        open_serial("/dev/ttyACM0")
