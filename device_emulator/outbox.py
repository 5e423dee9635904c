"""What a board on wall time has said and the link has not taken yet: bounded, whole messages, in order."""

from collections import deque

from hil.wire.link import BoardLink

CAPACITY = 1 << 20
"""Bytes that may wait: a quarter of a second of the fastest stream."""


class Outbox:
    """The queue between a streaming board and a link that may be full for a while."""

    def __init__(self, link: BoardLink, capacity: int = CAPACITY) -> None:
        self._link = link
        self._capacity = capacity
        self._waiting: deque[memoryview] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        """Bytes waiting."""
        return self._bytes

    def put(self, data: bytes, *, droppable: bool = False) -> bool:
        """Send, or have it wait its turn; False if it was droppable and found no room. Raises LinkClosed."""
        if droppable and self._bytes + len(data) > self._capacity:
            self.flush()
            if self._bytes + len(data) > self._capacity:
                return False
        if data:
            self._waiting.append(memoryview(data))
            self._bytes += len(data)
            self.flush()
        return True

    def flush(self) -> None:
        """Send what the link takes now. Raises LinkClosed."""
        while self._waiting:
            data = self._waiting[0]
            taken = self._link.offer(data)
            self._bytes -= taken
            if taken < len(data):
                self._waiting[0] = data[taken:]
                return
            self._waiting.popleft()

    def clear(self) -> None:
        """Forget what waits: its receiver is gone."""
        self._waiting.clear()
        self._bytes = 0
