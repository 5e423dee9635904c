"""What every link does: bytes in, bytes out."""

import errno
import socket
from typing import Protocol

from hil.wire.errors import LinkError
from hil.wire.frame_format import FrameFormat
from hil.wire.serial_format import SERIAL


class Link(Protocol):
    """Bytes, or whole frames, to and from one peer. Implementations: serial port, pty, CAN, UDP, in-process board.

    Attributes:
        name: the link as the user knows it, for messages.
        format: how messages become bytes on this link.
        arrived_ns: when the newest of the bytes last received reached this machine, by the kernel's stamp on the
            monotonic clock; 0 where nobody stamps them.
        advice: what to look at when the peer is silent, for messages.
    """

    name: str
    format: FrameFormat = SERIAL
    arrived_ns: int = 0
    advice: str = "is it a gyro board, on, at this baud rate?"

    def fileno(self) -> int | None:
        """Descriptor to wait on, or None where there is nothing to wait for."""
        ...

    def send(self, data: bytes) -> None:
        """Hand over all of `data`, waiting for room where the link has a bounded queue. Raises LinkClosed."""
        ...

    def receive(self, timeout_s: float | None) -> bytes:
        """Bytes that have arrived, at least one; b"" if none came within `timeout_s` seconds (None: wait for
        ever). Raises LinkClosed after a hang-up."""
        ...

    def close(self) -> None:
        """Let go of the link; a second call does nothing."""
        ...


class BoardLink(Link, Protocol):
    """The board's end of a link, which outlives its hosts.

    Attributes:
        url: what a host opens to get here.
        drop_when_full: lose what does not fit into the queue instead of waiting, as a port without flow control does:
            for a board on wall time, which cannot wait for its host.
    """

    url: str
    drop_when_full: bool

    def fileno(self) -> int: ...

    def offer(self, data: bytes | memoryview) -> int:
        """Send what fits now, on a link of frames in whole ones, and return how many bytes that was. Raises
        LinkClosed."""
        ...

    def await_host(self) -> None:
        """After LinkClosed: be ready for another host."""
        ...


class Claim:
    """A name that only one process on this machine (in this network namespace) holds; gone with the process.

    Raises:
        LinkError: somebody holds it.
    """

    def __init__(self, what: str, link: str, remedy: str) -> None:
        self._holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._holder.bind(f"\0gyrohil/{what}")  # an abstract name: no file to be left behind
        except OSError as error:
            self._holder.close()
            raise LinkError(
                f"{link}: {remedy if error.errno == errno.EADDRINUSE else error.strerror or error}"
            ) from None

    def release(self) -> None:
        """Let the next one have it; a second call does nothing."""
        self._holder.close()
