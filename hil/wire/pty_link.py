"""The board's end of a pseudo-terminal: what an emulated board is reached by, as if it were a serial port."""

import os
import termios
import tty

from hil.wire.errors import LinkError
from hil.wire.fd_link import FdLink


class PtyLink(FdLink):
    """Master side of a pty in raw mode.

    The first bytes of a host begin a conversation; when that host then closes the port, `send` and `receive`
    raise LinkClosed. `await_host` makes the link ready for the next one. A host that opens the port and
    leaves without a word goes unnoticed.

    Attributes:
        path: the port to open on the host's side, such as /dev/pts/3; `url` as a link.
        drop_when_full: lose what does not fit into the kernel's queue (16.9 kB) instead of waiting, as a port
            without
            flow control does: for a board on wall time, which cannot wait for its host.
        dropped_bytes: bytes lost that way.
    """

    def __init__(self, master: int, slave: int) -> None:
        self.path = os.ttyname(slave)
        self.url = f"serial:{self.path}"
        super().__init__(master, f"pty {self.path}")
        self._slave = slave
        self.drop_when_full = False
        self.dropped_bytes = 0

    def send(self, data: bytes) -> None:
        """Write all of `data`, or with `drop_when_full` what fits now. Raises LinkClosed."""
        if self.drop_when_full:
            self.dropped_bytes += len(data) - self.offer(data)
        else:
            super().send(data)

    def receive(self, timeout_s: float | None) -> bytes:
        """Up to 4096 bytes; b"" if none came within `timeout_s` seconds (None: wait for ever). Raises
        LinkClosed."""
        data = super().receive(timeout_s)
        if data and self._slave != -1:
            # While a slave descriptor of ours is open the kernel reports no hang-up; from now on we want to
            # know.
            os.close(self._slave)
            self._slave = -1
        return data

    def await_host(self) -> None:
        """After LinkClosed: wait for another host on the same path. Bytes the last one left unread are
        dropped."""
        if self._slave == -1:
            self._slave = os.open(self.path, os.O_NOCTTY)
            termios.tcflush(self._slave, termios.TCIFLUSH)

    def close(self) -> None:
        if self._slave != -1:
            os.close(self._slave)
            self._slave = -1
        super().close()


def open_pty() -> PtyLink:
    """A new pty, raw on both ends: no echo, no line discipline, every byte as it is.

    Raises:
        LinkError: the system has no pty left.
    """
    try:
        master, slave = os.openpty()
    except OSError as error:
        raise LinkError(f"pty: {error.strerror}; is /dev/pts mounted, and is kernel.pty.max reached?") from None
    tty.setraw(master)  # of both: Linux keeps one setting for the pair
    return PtyLink(master, slave)
