"""What the package brings keeps what the bench asks of its own."""

import select
import socket
import threading
from collections.abc import Iterator
from contextlib import closing
from functools import reduce

import numpy as np
import pytest
from doors.ascii_gyro import AsciiGyro
from doors.f64 import columns
from doors.tcp import open_tcp

from hil.bench.examples import find
from hil.boards.emulation import emulator
from hil.testing.conformance import AdapterConformance, ImporterConformance, LinkConformance
from hil.wire.links import open_link


def line(counter: int, rate: int) -> bytes:
    """A line of the sensor, its length always the same."""
    body = f"G,{counter:03d},{rate:06d}".encode()
    return b"$" + body + f"*{reduce(lambda sum_, byte: sum_ ^ byte, body):02X}\r\n".encode()


class TestAsciiGyro(AdapterConformance):
    make = AsciiGyro
    stream = b"".join(line(k, 100 * k) for k in range(20))
    samples = 20
    size = len(line(0, 0))
    odds = 0.0


class TestFilesOfDoubles(ImporterConformance):
    reader = staticmethod(columns)
    suffix = ".f64"
    content = np.column_stack([np.arange(500) / 1e3, np.sin(np.arange(500)), np.zeros(500)]).astype("<f8").tobytes()
    rows = 500


@pytest.fixture
def place() -> Iterator[str]:
    """A terminal server: an emulated board on a pty, carried over TCP."""
    with emulator(find("scenario", "s-slow")) as board, socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=_serve, args=(server, board.url))
        thread.start()
        try:
            yield "{}:{}".format(*server.getsockname())
        finally:
            server.shutdown(socket.SHUT_RDWR)
            thread.join()


def _serve(server: socket.socket, url: str) -> None:
    """One host after another, until the server is shut down."""
    while True:
        try:
            host, _ = server.accept()
        except OSError:
            return
        with host, closing(open_link(url)) as board:
            while True:
                if select.select([host], [], [], 0.001)[0]:
                    if not (data := host.recv(4096)):
                        break
                    board.send(data)
                host.sendall(board.receive(0.001))


class TestTcp(LinkConformance):
    open = staticmethod(open_tcp)
    bad = ("", "127.0.0.1", "127.0.0.1:0", "127.0.0.1:1", "nowhere.invalid:4001")
