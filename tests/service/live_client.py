"""A client of the live connection, as tests need one."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from websockets.sync.client import ClientConnection, connect

from hil.records.frame import Frame
from tests.service.serving import Serving


class LiveClient:
    """Says hello; `frames` and `messages` wait for what comes."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.kept: list[Frame] = []

    def say(self, **message: Any) -> None:
        self.socket.send(json.dumps(message))

    def receive(self, patience_s: float = 20.0) -> Frame | dict[str, Any]:
        data = self.socket.recv(timeout=patience_s)
        return json.loads(data) if isinstance(data, str) else Frame.of(data)

    def message(self, kind: str, patience_s: float = 20.0) -> dict[str, Any]:
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            received = self.receive(patience_s)
            if isinstance(received, dict) and received["kind"] == kind:
                return received
        raise AssertionError(f"no {kind} within {patience_s} s")

    def frame(self, subscription: int, patience_s: float = 20.0) -> Frame:
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            received = self.receive(patience_s)
            if isinstance(received, Frame) and received.id == subscription:
                return received
        raise AssertionError(f"no frame of {subscription} within {patience_s} s")


@contextmanager
def live(service: Serving, token: str | None = None, **options: Any) -> Iterator[LiveClient]:
    """A connection that has said hello."""
    with connect(f"ws://{service.address}/api/live", **options) as socket:
        client = LiveClient(socket)
        client.say(op="hello", token=service.token() if token is None else token)
        yield client
