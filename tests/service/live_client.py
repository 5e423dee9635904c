"""A client of the live connection, as tests need one: frames taken apart by the published layout."""

import json
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from websockets.sync.client import ClientConnection, connect

from tests.service.serving import Serving

_HEAD = struct.Struct("<IIIIddQ")  # docs/reference/service.md, Frames
_MAGIC = int.from_bytes(b"GYT1", "little")


@dataclass
class Frame:
    """One binary frame; low, high (channels, buckets)."""

    subscription: int
    begin_s: float
    step_s: float
    serial: int
    low: np.ndarray
    high: np.ndarray

    @property
    def buckets(self) -> int:
        return self.low.shape[1]


def taken_apart(data: bytes) -> Frame:
    """A frame by the published layout."""
    magic, subscription, channels, buckets, begin, step, serial = _HEAD.unpack_from(data)
    assert magic == _MAGIC
    assert len(data) == _HEAD.size + 8 * channels * buckets
    pairs = np.frombuffer(data, "<f4", offset=_HEAD.size).reshape(channels, buckets, 2)
    return Frame(subscription, begin, step, serial, pairs[:, :, 0], pairs[:, :, 1])


class LiveClient:
    """Says hello; `frames` and `messages` wait for what comes."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.kept: list[Frame] = []

    def say(self, **message: Any) -> None:
        self.socket.send(json.dumps(message))

    def receive(self, patience_s: float = 20.0) -> Frame | dict[str, Any]:
        data = self.socket.recv(timeout=patience_s)
        return json.loads(data) if isinstance(data, str) else taken_apart(data)

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
            if isinstance(received, Frame) and received.subscription == subscription:
                return received
        raise AssertionError(f"no frame of {subscription} within {patience_s} s")


@contextmanager
def live(service: Serving, token: str | None = None, **options: Any) -> Iterator[LiveClient]:
    """A connection that has said hello."""
    with connect(f"ws://{service.address}/api/live", **options) as socket:
        client = LiveClient(socket)
        client.say(op="hello", token=service.token() if token is None else token)
        yield client
