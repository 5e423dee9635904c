"""What is told to everybody who looks, as JSON objects: the newest job, run, state."""

from collections.abc import Callable
from typing import Any

Listener = Callable[[dict[str, Any]], None]


class LiveMessages:
    """Call it with a message; each listener gets it, and must not wait.  To be called in the service's event loop, from
    another thread by `loop.call_soon_threadsafe`.
    """

    def __init__(self) -> None:
        self._listeners: set[Listener] = set()

    def __call__(self, message: dict[str, Any]) -> None:
        for listener in list(self._listeners):
            listener(message)

    def add(self, listener: Listener) -> Callable[[], None]:
        """Have `listener` told from now on, until what is returned is called."""
        self._listeners.add(listener)
        return lambda: self._listeners.discard(listener)
