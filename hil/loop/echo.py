"""Whether the drives that SENSE shows in force mode are the ones that were sent.

The observer takes the echo for what the board drives.  A board whose echo is something else makes the record wrong, and
may drive what nobody sent.  docs/wire.md, "What a host does", has the rule.
"""

from hil.wire.messages import SenseFlags

_KEPT = 1 << 12  # drives remembered, by effective tick
_HELD, _SATURATED = int(SenseFlags.HELD), int(SenseFlags.SATURATED)


class Echo:
    """Told every drive and every row of a board with such a `latency`, whose DRIVE_LIMIT is `limit`.

    The row at which a board stops by itself shows zero force before STATUS says why: so a row that disagrees is held
    against the board only once another one follows it.
    """

    def __init__(self, latency: int, limit: int) -> None:
        self._latency = latency
        self._limit = limit
        self._sent: list[tuple[int, int, int] | None] = [None] * _KEPT
        self.forget()

    def forget(self) -> None:
        """The board was armed again: nothing is due until it runs."""
        self._due: int | None = None  # tick of the first interval that must be driven
        self._last: tuple[int, int, int] | None = None
        self._odd = ""

    def runs(self, tick: int) -> None:
        """The board has said RUNNING at `tick`."""
        if self._due is None:
            self._due = tick + self._latency

    def sent(self, ux: int, uy: int, effective_tick: int) -> None:
        """DRIVE_FORCE has left."""
        self._sent[effective_tick % _KEPT] = effective_tick, ux, uy

    def saw(self, tick: int, ux: int, uy: int, flags: int) -> str:
        """The next row; in words what is wrong with the one before it, "" if nothing is."""
        if self._odd:
            return self._odd
        begin = tick - 1
        last, self._last = self._last, (tick, ux, uy)
        meant = self._sent[begin % _KEPT]
        if meant is not None and meant[0] != begin:
            meant = None  # of long ago
        if meant is not None:
            _, x, y = meant
            limit = self._limit
            if ux == max(min(x, limit), -limit) and uy == max(min(y, limit), -limit):
                if self._due is None and (ux or uy):
                    self._due = begin
                return ""
        if self._due is None or begin < self._due:
            return ""
        if flags & _HELD:
            if last is None or last[0] != begin or last[1:] == (ux, uy):
                return ""
            if flags & _SATURATED and _less(ux, uy, *last[1:]):
                return ""
            told = f"the one before it {last[1]} and {last[2]}, and it is flagged HELD"
        elif meant is None:
            told = "nothing was sent for it, and it is not flagged HELD"
        elif flags & _SATURATED and _less(ux, uy, x, y):
            return ""
        else:
            told = f"{x} and {y} were sent for it"
        self._odd = f"SENSE of tick {tick} shows the drive codes {ux} and {uy}; {told}"
        return ""


def _less(ux: int, uy: int, x: int, y: int) -> bool:
    """Whether the first drive is the second one, limited further."""
    return abs(ux) <= abs(x) and abs(uy) <= abs(y) and ux * x >= 0 and uy * y >= 0
