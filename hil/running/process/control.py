"""The loop's line to the clients of a run: what it is about to record into, what it is asked to change, what the
board has just said.

A socket that keeps messages apart, never waited for.  The loop looks at it ten times a second of bench time, between
two samples, which costs a microsecond; who does not read loses what is told, and holds nothing up.
"""

import json
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from hil.records.layout import Layout

LARGEST = 1 << 16
"""Bytes of a message."""
LOOKS_PER_S = 10.0


class Control:
    """The loop's end; `descriptor` is inherited and owned from now on."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.socket(fileno=descriptor)
        self._socket.setblocking(False)

    def show(self, rings: Mapping[str, int], layouts: Mapping[str, Layout]) -> None:
        """Hand out descriptors of the rings, to be read only, with what their rows are; one message for each, in which
        the other side can only look."""
        for stem, descriptor in rings.items():
            message = {"track": stem, "layout": json.loads(layouts[stem].to_json())}
            with suppress(OSError):
                socket.send_fds(self._socket, [json.dumps(message).encode()], [descriptor])

    def show_process(self) -> None:
        """Hand out a descriptor of this process, by which it can be sent the signal that ends the loop and no other
        process can, however soon its number is used again."""
        with suppress(OSError):
            descriptor = os.pidfd_open(os.getpid())
            try:
                socket.send_fds(self._socket, [json.dumps({"loop": True}).encode()], [descriptor])
            finally:
                os.close(descriptor)

    def tell(self, **message: Any) -> None:
        """A message, if there is room for it."""
        with suppress(OSError):
            self._socket.send(json.dumps(message).encode())

    def close(self) -> None:
        self._socket.close()

    def asked(self) -> Iterator[dict[str, Any]]:
        """What has been asked since this was last called."""
        while True:
            try:
                said = self._socket.recv(LARGEST)
            except OSError:  # nothing there, or nobody
                return
            if not said:
                return
            yield json.loads(said)
