"""Somebody in the way: between host and board on UDP, with every datagram in hand. On 127.0.0.1 only."""

import select
import socket
import struct
import threading
from collections.abc import Callable

LOOPBACK = "127.0.0.1"


def attacking_socket(source: str = LOOPBACK, port: int = 0) -> socket.socket:
    """A socket that sends by the loopback interface; answers to it are to be read within a moment."""
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    wire.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(LOOPBACK))
    wire.bind((source, port))
    wire.settimeout(0.3)
    return wire


def drained(wire: socket.socket) -> list[bytes]:
    """What has come, and comes until it is quiet."""
    datagrams = []
    try:
        while len(datagrams) < 100_000:
            datagrams.append(wire.recv(65536))
    except TimeoutError:
        pass
    return datagrams


class InTheWay:
    """Takes the place of the board for the host, and of the host for the board.

    Attributes:
        to_board, to_host: decide what becomes of a datagram: a list of those to be passed on in its place.
        from_host, from_board: everything recorded.
        port: from which it speaks to the board, as its peer does.
    """

    def __init__(self, meets: tuple[str, int], board: tuple[str, int]) -> None:
        self.from_host: list[bytes] = []
        self.from_board: list[bytes] = []
        self.to_board: Callable[[bytes], list[bytes]] = lambda datagram: [datagram]
        self.to_host: Callable[[bytes], list[bytes]] = lambda datagram: [datagram]
        self._board = board
        self._host: tuple[str, int] | None = None
        self._near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._near.bind(meets)
        joined = struct.pack("4s4s", socket.inet_aton(meets[0]), socket.inet_aton(LOOPBACK))
        self._near.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, joined)
        self._far = attacking_socket()
        self.port: int = self._far.getsockname()[1]
        self._stop, self._stopped = socket.socketpair()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def inject(self, datagram: bytes) -> None:
        """Send to the board, from the peer's address."""
        self._far.sendto(datagram, self._board)

    def inject_to_host(self, datagram: bytes) -> None:
        """Send to the host, from the board's address as the host knows it."""
        assert self._host is not None
        self._near.sendto(datagram, self._host)

    def close(self) -> None:
        """Step aside."""
        self._stop.close()
        self._thread.join()
        for wire in (self._near, self._far, self._stopped):
            wire.close()

    def _run(self) -> None:
        while True:
            ready, _, _ = select.select([self._near, self._far, self._stopped], [], [])
            if self._stopped in ready:
                return
            if self._near in ready:
                datagram, self._host = self._near.recvfrom(65536)
                self.from_host.append(datagram)
                for each in self.to_board(datagram):
                    self._far.sendto(each, self._board)
            if self._far in ready:
                datagram = self._far.recv(65536)
                self.from_board.append(datagram)
                for each in self.to_host(datagram):
                    if self._host is not None:
                        self._near.sendto(each, self._host)
