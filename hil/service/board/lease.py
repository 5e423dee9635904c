"""Who may operate the board: one holder at a time, for a purpose, for a time that has to be renewed; others queue.

A client that dies stops renewing, and its lease, or its place in the queue, ends by itself.
"""

import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hil.service.problems import Problem

LONGEST_S = 3600.0
_WAITS_S = 30.0  # for a renewal of a place in the queue
_QUEUE = 64


@dataclass
class _Claim:
    key: str
    holder: str
    purpose: str
    seconds: float
    until: float

    def has(self, key: str) -> bool:
        """Whether that is its key, in a time that does not depend on where it differs."""
        return secrets.compare_digest(self.key.encode(), key.encode("utf-8", "replace"))


class Leases:
    """The lease of one board, and the queue for it. Times are of `now`, a clock in seconds that only goes forward;
    `told` is called when anything has changed.
    """

    def __init__(self, told: Callable[[], None] = lambda: None, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._told = told
        self._held: _Claim | None = None
        self._queue: list[_Claim] = []

    def take(self, holder: str, purpose: str, seconds: float, *, wait: bool) -> dict[str, Any]:
        """The lease, or with `wait` a place in the queue. Raises Problem 409, which names the holder."""
        self._expire()
        claim = _Claim(secrets.token_urlsafe(16), holder, purpose, seconds, self._now() + seconds)
        if self._held is None and not self._queue:
            self._held = claim
        elif not wait:
            raise self._refusal()
        elif len(self._queue) >= _QUEUE:
            raise Problem(409, f"{_QUEUE} are waiting for the board already", "try again later")
        else:
            claim.until = self._now() + _WAITS_S
            self._queue.append(claim)
        self._told()
        return self._of(claim)

    def renew(self, key: str) -> dict[str, Any]:
        """The lease for as long again, or the place in the queue kept. Raises Problem 409 where it is no more."""
        self._expire()
        if self._held is not None and self._held.has(key):
            self._held.until = self._now() + self._held.seconds
            self._told()
            return self._of(self._held)
        for claim in self._queue:
            if claim.has(key):
                claim.until = self._now() + _WAITS_S
                return self._of(claim)
        raise (
            self._refusal()
            if self._held is not None
            else Problem(409, "this lease has ended", "take a new one: POST /api/lease")
        )

    def give_back(self, key: str) -> None:
        """The lease, or the place in the queue, is no longer needed."""
        self._expire()
        if self._held is not None and self._held.has(key):
            self._held = None
        self._queue = [claim for claim in self._queue if not claim.has(key)]
        self._expire()
        self._told()

    def end(self) -> None:
        """The lease ends, whatever client has it."""
        self._held = None
        self._expire()
        self._told()

    def require(self, key: str | None) -> str:
        """Who operates the board. Raises Problem 409 where `key` is not that of the lease."""
        self._expire()
        if self._held is None:
            raise Problem(409, "nobody has the lease of the board", "take it: POST /api/lease, then send X-Lease")
        if key is None or not self._held.has(key):
            raise self._refusal()
        return self._held.holder

    @property
    def key(self) -> str | None:
        """Of the lease that is held, None while nobody has it; another holder has another one."""
        self._expire()
        return None if self._held is None else self._held.key

    def told(self) -> dict[str, Any]:
        """The part of the board's state: no keys in it."""
        self._expire()
        held = None if self._held is None else self._named(self._held)
        return {"lease": held, "queue": [{"holder": one.holder, "purpose": one.purpose} for one in self._queue]}

    def _expire(self) -> None:
        now = self._now()
        before = self._held, len(self._queue)
        if self._held is not None and self._held.until <= now:
            self._held = None
        self._queue = [claim for claim in self._queue if claim.until > now]
        if self._held is None and self._queue:
            self._held = self._queue.pop(0)
            # Until its next renewal, which comes at once from a client that lives.
            self._held.until = now + min(self._held.seconds, _WAITS_S)
        if before != (self._held, len(self._queue)):
            self._told()

    def _of(self, claim: _Claim) -> dict[str, Any]:
        place = 0 if claim is self._held else self._queue.index(claim) + 1
        return {"lease": claim.key, "place": place, **self._named(claim)}

    def _named(self, claim: _Claim) -> dict[str, Any]:
        left = max(claim.until - self._now(), 0.0)
        return {"holder": claim.holder, "purpose": claim.purpose, "until": time.time() + left, "left_s": left}

    def _refusal(self) -> Problem:
        if self._held is None:
            first = self._queue[0] if self._queue else None
            return Problem(409, f"{first.holder if first else 'somebody'} is next for the board", "wait: true queues")
        left = max(self._held.until - self._now(), 0.0)
        return Problem(
            409,
            f"{self._held.holder} has the board for {left:.0f} s more, unless renewed: {self._held.purpose}",
            'ask him, or queue: POST /api/lease with "wait": true',
        )
