"""Whether the drives that SENSE shows in force mode are the ones that were sent.

The observer takes the echo for what the board drives.  A board whose echo is something else makes the record wrong, and
may drive what nobody sent.  docs/wire.md, "What a host does", has the rule; native/echo.h judges by it.
"""

import ctypes

from hil.running.native import LIBRARY, NONE, EchoState

_HELD, _UNSENT = 1, 2  # of what is odd


class Echo:
    """Told every drive and every row of a board with such a `latency`, whose DRIVE_LIMIT is `limit`.

    The row at which a board stops by itself shows zero force before STATUS says why: so a row that disagrees is held
    against the board only once another one follows it.

    Attributes:
        state: what it knows, for the turn in C.
    """

    def __init__(self, latency: int, limit: int) -> None:
        self.state = EchoState(latency=latency, limit=limit)
        for drive in self.state.sent:
            drive.tick = NONE
        self.forget()

    def forget(self) -> None:
        """The board was armed again: nothing is due until it runs."""
        LIBRARY.echo_forget(ctypes.byref(self.state))

    def runs(self, tick: int) -> None:
        """The board has said RUNNING at `tick`."""
        if self.state.due == NONE:
            self.state.due = tick + self.state.latency

    def sent(self, ux: int, uy: int, effective_tick: int) -> None:
        """DRIVE_FORCE has left."""
        LIBRARY.echo_sent(ctypes.byref(self.state), ux, uy, effective_tick)

    def saw(self, tick: int, ux: int, uy: int, flags: int) -> str:
        """The next row; in words what is wrong with the one before it, "" if nothing is."""
        return self.odd if LIBRARY.echo_saw(ctypes.byref(self.state), tick, ux, uy, flags) else ""

    @property
    def odd(self) -> str:
        """In words what is wrong with a row, "" if nothing is."""
        state = self.state
        if not state.odd:
            return ""
        (ux, uy), (x, y) = state.odd_shown, state.odd_meant
        if state.odd == _HELD:
            told = f"the one before it {x} and {y}, and it is flagged HELD"
        elif state.odd == _UNSENT:
            told = "nothing was sent for it, and it is not flagged HELD"
        else:
            told = f"{x} and {y} were sent for it"
        return f"SENSE of tick {state.odd_tick} shows the drive codes {ux} and {uy}; {told}"
