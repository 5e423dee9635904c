"""One host to a board, where the medium itself would carry several."""

import errno
import socket

from hil.wire.errors import LinkError


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
