"""Asking an armed board for its time while the loop runs, and more often before and after it.

The loop neither waits for an answer nor looks for one: answers come between samples, and the endpoint notes when they
came. One that comes by itself is followed by a second question at once: the first may have waited for the board to be
done with something, most of all with what it does when the host has spoken, and the second will not. What follows from
the answers is worked out after the run (`hil.records.clock`).
"""

import time
from collections import deque

from hil.running.recording.recorder import Track
from hil.wire.endpoint import Endpoint
from hil.wire.messages import TimeSync

EXCHANGES_PER_S = 5.0
_BURST, _BURST_S = 32, 0.1
_PATIENCE_S = 0.025
_REST_S = 2e-4  # as a loop rests: what carries the bytes of a pty needs a processor, too
_LATEST = 1 << 63  # board clocks beyond are no time


class ClockExchanges:
    """TIME_SYNC with the board behind an endpoint, `per_s` a second at most; what comes of it goes to `track`, rows as
    in `clock.arrow`."""

    def __init__(self, endpoint: Endpoint, track: Track, per_s: float = EXCHANGES_PER_S) -> None:
        self._endpoint = endpoint
        self._track = track
        self._asked: deque[int] = deque(maxlen=64)
        self._answers = 0
        self._due_ns = 0
        self._again = False
        self._every_ns = round(1e9 / per_s)

    def burst(self) -> None:
        """Many exchanges at once, waiting for each: before ARM, or in SAFE. Raises LinkClosed."""
        end = time.monotonic() + _BURST_S
        for _ in range(_BURST):
            self._ask()
            self._await()
            if time.monotonic() >= end:
                break
            time.sleep(_REST_S)

    def ask(self) -> None:
        """A question, if it is time for one, of a board that has ever answered. Raises LinkClosed."""
        self.keep()
        if self._answers and time.monotonic_ns() >= self._due_ns:
            self._ask()
            self._again = True

    def follow(self) -> None:
        """The second question, if the answer to the first has just come. Raises LinkClosed."""
        if self._endpoint.exchanges and self._again:
            self._again = False
            self.keep()
            self._ask()

    def keep(self) -> None:
        """Record the answers that have come."""
        answers = self._endpoint.exchanges
        while answers:
            sent_ns, board_ns, received_ns, tick = answers.popleft()
            if sent_ns in self._asked and board_ns < _LATEST:
                self._asked.remove(sent_ns)
                self._answers += 1
                self._track.put(tick, sent_ns, board_ns, received_ns)

    def _ask(self) -> None:
        now_ns = self._endpoint.ask_time()
        self._asked.append(now_ns)
        self._due_ns = now_ns + self._every_ns

    def _await(self) -> None:
        """Wait for an answer to the last question, not for ever; what else comes stays for others."""
        endpoint, answered = self._endpoint, self._answers
        end = time.monotonic() + _PATIENCE_S
        while self._answers == answered and (left := end - time.monotonic()) > 0.0:
            items = endpoint.poll_new(left)
            endpoint.keep([item for item in items if not isinstance(item.message, TimeSync)])
            self.keep()
