"""`tcp:HOST:PORT`: the wire's serial framing over a TCP connection, such as a terminal server has for a UART."""

import select
import socket

from hil.wire.errors import LinkClosed, LinkError
from hil.wire.serial_format import SERIAL

_CONNECT_S = 3.0
_MOST = 4096


class TcpLink:
    """As `hil.wire.link.Link`."""

    format = SERIAL
    arrived_ns = 0
    advice = "does the terminal server lead to the board, at its baud rate?"

    def __init__(self, name: str, connection: socket.socket) -> None:
        self.name = name
        self._connection = connection

    def fileno(self) -> int:
        """Descriptor to wait on."""
        return self._connection.fileno()

    def send(self, data: bytes) -> None:
        """All of it. Raises LinkClosed."""
        try:
            self._connection.sendall(data)
        except OSError as error:
            raise LinkClosed(f"{self.name}: {error.strerror}") from None

    def receive(self, timeout_s: float | None) -> bytes:
        """What has come within that time. Raises LinkClosed after a hang-up."""
        try:
            if not select.select([self._connection], [], [], timeout_s)[0]:
                return b""
            data = self._connection.recv(_MOST)
        except (OSError, ValueError):
            data = b""
        if not data:
            raise LinkClosed(f"{self.name}: the other end has hung up")
        return data

    def close(self) -> None:
        """Hang up."""
        self._connection.close()


def open_tcp(rest: str) -> TcpLink:
    """Connect to HOST:PORT. Raises LinkError."""
    host, _, port = rest.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise LinkError(f"tcp:{rest}: expected tcp:HOST:PORT, such as tcp:192.168.1.7:4001")
    try:
        connection = socket.create_connection((host, int(port)), _CONNECT_S)
    except OSError as error:
        why = error.strerror or error
        raise LinkError(f"tcp:{rest}: {why}; is the terminal server on, and this its port?") from None
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return TcpLink(f"tcp:{rest}", connection)
