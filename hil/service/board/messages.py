"""What the service and the process that holds the board say to each other: JSON messages over a socket that keeps them
apart, some with a descriptor.

The service asks {"n": number, "do": verb, …}; the holder answers {"n": number, …} with `said` or `refused`, and tells
{"board": state}, {"track": name, "layout": …} with the descriptor of a ring, {"loop": true} with that of the loop's
process, {"run": …} when one has ended.
"""

import json
import os
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

LARGEST = 1 << 17
"""Bytes of a message; a bench file is a few thousand."""

LOOP = "loop"
"""Message that brings the loop's process; SIGTERM to it is SAFE."""

STACKS = signal.SIGUSR1
"""Has the process that holds the board write into its log where each of its threads is."""

Message = dict[str, Any]

NOBODY: Message = {
    "connected": False,
    "lost": False,
    "left": False,
    "link": None,
    "emulated": False,
    "identity": None,
    "state": None,
    "reason": "",
    "words": "",
    "run": None,
    "last_run": None,
    "last_verdict": None,
    "stage": "",
    "done": 0,
    "total": 0,
    "bench": None,
    "duration_s": None,
    "settings": {},
    "safe_tick": None,
}
"""State without a board."""


@contextmanager
def in_folder(place: Path) -> Iterator[str]:
    """A name for the socket at `place` that is short enough for one, however deep its folder lies."""
    folder = os.open(place.parent, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield f"/proc/self/fd/{folder}/{place.name}"
    finally:
        os.close(folder)


def send(sock: socket.socket, message: Message, descriptor: int | None = None) -> None:
    """One message. Raises OSError, BlockingIOError where there is no room for it."""
    data = json.dumps(message).encode()
    if len(data) > LARGEST:
        raise OSError("the message is too long")
    if descriptor is None:
        sock.send(data)
    else:
        socket.send_fds(sock, [data], [descriptor])


def receive(sock: socket.socket) -> tuple[Message, list[int]] | None:
    """The next message with its descriptors, which the caller owns; None where the other side has closed.

    Raises BlockingIOError where none is there, OSError.
    """
    data, descriptors, _, _ = socket.recv_fds(sock, LARGEST, 4)
    return (json.loads(data), list(descriptors)) if data else None
