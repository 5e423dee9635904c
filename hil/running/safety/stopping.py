"""Bringing a board to SAFE, and what counts as confirmed.

STATUS has to say SAFE in answer to the host's SAFE, and no SENSE row that was sampled after it may show a drive.  A
board streams nothing in SAFE, so the host listens for a while longer than a block takes.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

from hil.running.safety.latching import LATCHING
from hil.wire.endpoint import Endpoint
from hil.wire.errors import WireError
from hil.wire.messages import Safe, State, Status
from hil.wire.sense import Sense
from hil.wire.stream import Received, unwrap

_LISTEN_S = 0.1
_LISTEN_AT_MOST_S = 1.0
_ASKED = 8  # times within the patience: lines lose frames
_AHEAD = 1.5  # by which a board's ticks may run ahead of this host's clock


class Stopped(NamedTuple):
    """What came of SAFE: the board's STATUS, None without one; whether the stop is confirmed, and if not why; what the
    board does in SAFE beside it, one clause each, "" for nothing."""

    status: Status | None
    confirmed: bool
    why: str = ""


def bring_to_safe(
    endpoint: Endpoint,
    reason: int,
    patience_s: float,
    *,
    rate_Hz: float,
    block: int = 1,
    newest: int | None = None,
    answered: Callable[[Status], None] = lambda _: None,
) -> Stopped:
    """Send SAFE until it is answered or `patience_s` is over, then listen whether the drive is gone.

    `newest` is the tick of the last row known; `block` rows come at a time; `answered` is told STATUS as soon as it is
    there, before anything is listened for. Raises nothing that the link does.
    """
    rows = _Rows(newest)
    sent, begin = 0, time.monotonic()
    status: Status | None = None
    try:
        while status is None:
            now = time.monotonic()
            if now >= begin + patience_s or (sent == _ASKED and endpoint.link.fileno() is None):
                seconds = f"{sent} times in {patience_s:g} s"
                still = rows.still(begin + 0.5 * patience_s)
                return Stopped(None, False, f"the board did not answer SAFE, sent {seconds}{still}")
            if now >= begin + sent * patience_s / _ASKED or endpoint.link.fileno() is None:
                endpoint.send(Safe(reason))
                sent += 1
            again = begin + min(sent * patience_s / _ASKED, patience_s)
            items = endpoint.poll(max(again - time.monotonic(), 0.0))
            for k, item in enumerate(items):
                message = item.message
                if isinstance(message, Status) and _answers(message, reason):
                    elapsed = (time.monotonic() - begin) * rate_Hz * _AHEAD
                    rows.stop(unwrap(message.tick, item.tick), round(elapsed) + 2 * block + 2)
                    status = message
                    answered(status)
                    items = items[k + 1 :]
                    break
                rows.hear(item)
            else:
                items = []
        _listen(endpoint, rows, items, min(max(_LISTEN_S, 2.0 * block / rate_Hz), _LISTEN_AT_MOST_S))
    except WireError as error:
        if status is None:
            return Stopped(None, False, f"the board cannot be told SAFE any more: {error}")
        # It hung up after it had answered: what it said before stands.
    if rows.driven:
        return Stopped(status, False, f"STATUS says SAFE, yet {rows.driven}")
    return Stopped(status, True, rows.streaming)


def _answers(status: Status, reason: int) -> bool:
    """Whether STATUS answers SAFE for `reason`: one that latches wins over one that does not, such as WATCHDOG, which
    the board says by itself."""
    return status.state == State.SAFE and (reason not in LATCHING or status.reason in LATCHING)


class _Rows:
    """The rows that come while a board is brought to SAFE."""

    def __init__(self, newest: int | None) -> None:
        self._newest = newest
        self._last: int | None = None  # tick of the last row that may still show a drive
        self._codes: tuple[int, int] = (0, 0)
        self._heard_s: float  # when those came
        self.driven = ""
        self.streaming = ""

    def hear(self, item: Received) -> None:
        """Note a row, once the board has stopped judge it."""
        sense = item.message
        if not isinstance(sense, Sense):
            return
        end = item.tick + len(sense.codes) - 1
        self._codes = int(sense.codes[-1, 2]), int(sense.codes[-1, 3])
        self._heard_s = time.monotonic()
        if self._last is None:
            self._newest = end if self._newest is None else max(self._newest, end)
            return
        if end <= self._last:
            return
        self.streaming = "the board goes on streaming in SAFE"
        late = sense.codes[max(self._last + 1 - item.tick, 0) :, 2:]
        if not self.driven and late.any():
            ux, uy = next(row for row in late.tolist() if any(row))
            self.driven = f"SENSE of tick {end} still shows a drive, codes {ux} and {uy}"

    def stop(self, tick: int, ahead: int) -> None:
        """The board says that it is SAFE at `tick`; it cannot be further ahead of its last row than `ahead`.

        The interval in which SAFE came may have begun driven: its row ends one tick later.
        """
        newest = tick if self._newest is None else self._newest
        self._last = (tick if newest <= tick <= newest + ahead else newest) + 1

    def still(self, since_s: float) -> str:
        """What the rows show of a board that does not answer; those that came before `since_s`, by the monotonic clock,
        may have been sampled before SAFE reached it and say nothing.
        """
        if not any(self._codes) or self._heard_s < since_s:
            return ""
        return f", and SENSE still shows a drive, codes {self._codes[0]} and {self._codes[1]}"


def _listen(endpoint: Endpoint, rows: _Rows, items: list[Received], seconds: float) -> None:
    end = time.monotonic() + seconds
    while True:
        for item in items:
            rows.hear(item)
        left = end - time.monotonic()
        if left <= 0.0 or (not items and endpoint.link.fileno() is None):
            return
        items = endpoint.poll(left)
