"""A board's end of a pty that says what a test has it say, and the host's `Endpoint` at the other: for rules that need
no loop. Bytes travel as they do to a board; nothing of the bench is replaced.
"""

import select
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed
from hil.wire.links import open_link
from hil.wire.messages import Message, SafeReason, State, Status
from hil.wire.pty_link import open_pty
from hil.wire.sense import Sense
from hil.wire.stream import Received, Receiver, Transmitter

Answer = Callable[[Message], list[Message]]


def status(state: int = State.SAFE, reason: int = SafeReason.HOST_REQUEST, tick: int = 0, **counts: int) -> Status:
    """STATUS, its counters zero but for `counts`."""
    return Status(state, reason, 0, 0, 0, 0, 0, 0, 0, tick)._replace(**counts)


def rows(*drives: tuple[int, int], flags: int = 0) -> Sense:
    """SENSE of as many rows, which show these drives."""
    return Sense(np.array([(5, -5, *drive) for drive in drives], np.int32), 2, flags)


class Far:
    """The board's end. `answer` says what it answers to each message, `closing` hangs up.

    Attributes:
        heard: what it was told, in order.
        tick: in the header of all it says.
    """

    def __init__(self) -> None:
        self.link = open_pty()
        self.rx, self.tx = Receiver(), Transmitter()
        self.heard: list[Message] = []
        self.tick = 0
        self.answer: Answer = lambda _: []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def say(self, *messages: Message, tick: int | None = None) -> None:
        """Now; the header's tick is `tick`."""
        header = self.tick if tick is None else tick
        self.link.send(b"".join(self.tx.encode(message, header) for message in messages))

    def lose(self, frames: int) -> None:
        """So many frames never arrive."""
        self.tx.seq = (self.tx.seq + frames) & 0xFFFF

    def say_bytes(self, data: bytes) -> None:
        """As they are."""
        self.link.send(data)

    def count(self, kind: type) -> int:
        """Messages of a kind that it was told."""
        return sum(isinstance(message, kind) for message in self.heard)

    def _serve(self) -> None:
        while not self._stop.is_set():
            if not select.select([self.link.fileno()], [], [], 0.005)[0]:
                continue
            try:
                items = self.rx.feed(self.link.receive(0.0))
            except LinkClosed:
                return
            for item in items:
                self.heard.append(item.message)
                self.say(*self.answer(item.message))

    def start(self) -> None:
        """Answer from now on."""
        self._thread.start()

    def end(self) -> None:
        """Stop answering and hang up; a second call does nothing."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        self.link.close()


@contextmanager
def connected() -> Iterator[tuple[Endpoint, Far]]:
    """Both ends; the far one answers in a thread of its own."""
    far = Far()
    host = Endpoint(open_link(far.link.url))
    far.start()
    try:
        yield host, far
    finally:
        host.close()
        far.end()


def arrived(host: Endpoint, count: int, patience_s: float = 10.0) -> list[Received]:
    """So many messages at the host, taken out."""
    items: list[Received] = []
    end = time.monotonic() + patience_s
    while len(items) < count and time.monotonic() < end:
        items += host.poll(0.05)
    assert len(items) == count, items
    return items
