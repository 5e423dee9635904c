"""A link on a file descriptor: select, then one read or write.

`select` rather than a poll object because its timeout has microseconds, and rather than reading until EAGAIN
because a busy loop starves the kernel worker that delivers the bytes of a pty.
"""

import errno
import os
import select

from hil.wire.errors import LinkClosed
from hil.wire.link import Link

READ_SIZE = 4096
_HANGUP = (0, errno.EIO, errno.ENXIO, errno.ENODEV, errno.EPIPE, errno.EBADF)


class FdLink(Link):
    """A link on a terminal's descriptor, which it sets to non-blocking and owns.

    `name` is the link as the user knows it, for messages.
    """

    def __init__(self, fd: int, name: str) -> None:
        os.set_blocking(fd, False)
        self.name = name
        self._fd = fd
        self._watch = [fd]

    def fileno(self) -> int:
        return self._fd

    def send(self, data: bytes) -> None:
        """Write all of `data`, waiting for room in the kernel's queue. Raises LinkClosed."""
        while True:
            written = self.offer(data)
            if written == len(data):
                return
            data = data[written:]
            self._wait_writable()

    def receive(self, timeout_s: float | None) -> bytes:
        """Up to 4096 bytes; b"" if none came within `timeout_s` seconds (None: wait for ever). Raises
        LinkClosed."""
        if self._fd == -1:
            raise LinkClosed(f"{self.name}: the link is closed")
        if not select.select(self._watch, (), (), timeout_s)[0]:
            return b""
        try:
            data = os.read(self._fd, READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self.closed(error.errno or 0) from None
        if not data:
            raise LinkClosed(f"{self.name}: the other end hung up")
        return data

    def close(self) -> None:
        if self._fd != -1:
            os.close(self._fd)
            self._fd = -1

    def offer(self, data: bytes | memoryview) -> int:
        """Write what fits now and return how much that was. Raises LinkClosed."""
        if self._fd == -1:
            raise LinkClosed(f"{self.name}: the link is closed")
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self.closed(error.errno or 0) from None

    def _wait_writable(self) -> None:
        poller = select.poll()  # tells a hang-up apart, which select takes for "not writable"
        poller.register(self._fd, select.POLLOUT)
        for _, events in poller.poll():
            if events & ~select.POLLOUT:
                raise LinkClosed(f"{self.name}: the other end hung up")

    def closed(self, number: int) -> LinkClosed:
        """What it means that the descriptor cannot be used, by errno; 0 where it read nothing."""
        what = "the other end hung up" if number in _HANGUP else os.strerror(number)
        return LinkClosed(f"{self.name}: {what}")
