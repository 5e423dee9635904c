"""How long a trace may still take: what is left of the stage at hand, by its own pace, and what usually follows.

What follows hangs on what is found, so this is rough, and is said only where there is ground for it.
"""

import time
from collections.abc import Callable

_FOLLOWS = {"effects": 0.3, "checks": 0.2, "experiments": 0.0}
"""What follows a stage, as a share of all that was spent by its end.  There may be fewer rounds of effects than are
counted on.
"""

_GROUND_S = 3.0
"""So long nothing is said."""

_JUMP = 1.5
"""An estimate counts down by the clock; a new one that is less than so many times longer does not move it up."""


class TimeLeft:
    """Told of every step of a trace, it estimates the seconds that are left."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began = clock()
        self._stage, self._stage_began, self._first = "", self._began, 0
        self._end: float | None = None

    def told(self, stage: str, done: int, total: int) -> float | None:
        """Seconds left, None where nobody can tell."""
        now = self._clock()
        if stage not in _FOLLOWS:
            return self._said(now)
        if stage != self._stage:
            self._stage, self._stage_began, self._first = stage, now, done
        if 0 < done <= total and now - self._began > _GROUND_S and (done == total or done > self._first):
            rest = (total - done) * (now - self._stage_began) / max(done - self._first, 1)
            self._estimate(now, rest + _FOLLOWS[stage] * (now - self._began + rest))
        return self._said(now)

    def _estimate(self, now: float, left: float) -> None:
        said = self._said(now)
        if said is None or left < said or left > _JUMP * said:
            self._end = now + left

    def _said(self, now: float) -> float | None:
        return None if self._end is None else max(self._end - now, 0.0)


def in_words(seconds: float) -> str:
    """As rough as it is: about so many seconds, tens of them, or minutes."""
    if seconds < 10.0:
        return "a few seconds left"
    if seconds < 90.0:
        return f"about {round(seconds, -1):.0f} s left"
    return f"about {round(seconds / 60.0):.0f} min left"
