"""The module `socket`, but for the class of its sockets: for one module of the wire alone."""

import socket
from typing import Any


class Sockets:
    """As `socket`, with `made` in the place of `socket.socket`."""

    def __init__(self, made: Any) -> None:
        self.socket = made

    def __getattr__(self, name: str) -> Any:
        return getattr(socket, name)
