"""Force mode: the host answers every sample with a drive.

What happens between a sample and its answer is one call into C (native/force.h).

Whether the drives that SENSE shows in force mode are the ones that were sent.

The observer takes the echo for what the board drives.  A board whose echo is something else makes the record wrong, and
may drive what nobody sent.  docs/wire.md, "What a host does", has the rule; native/echo.h judges by it.
"""

import ctypes
import math
from collections.abc import Sequence

from hil.plugins.plugged import Plugged
from hil.running.hindsight import Hindsight
from hil.running.native import LIBRARY, NONE, EchoState, Mode
from hil.running.skeleton import Setup
from hil.running.turns import TurnLoop
from hil.wire.messages import DriveForce, Message
from hil.wire.sense import SenseRow


class ForceLoop(TurnLoop):
    """One run in force mode."""

    DRIVE = DriveForce
    MODE = Mode.FORCE

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        # A plug-in cannot be tried with two drives, one beside the other.
        self._hindsight = None if isinstance(setup.observer, Plugged) else Hindsight(setup.observer)
        self._shown = Echo(setup.identity.latency_ticks, int(setup.registers.get("DRIVE_LIMIT", self._drive_limit)))

    def _bind(self) -> None:
        self._state.echo = ctypes.addressof(self._shown.state)

    def _odd(self) -> str:
        return self._shown.odd

    def _refused(self) -> str:
        ux, uy = self._state.refused
        return (
            f"the control law gave drive codes of {ux:g} and {uy:g}, [limits] and the board allow ± "
            f"{self._state.code_limit}"
        )

    def _may_look_after(self) -> int:
        return 1 if self._is_undecided else super()._may_look_after()

    @property
    def _is_undecided(self) -> bool:
        return self._hindsight is not None and self._hindsight.undecided

    def _saw(self, rows: list[SenseRow]) -> None:
        for row in rows if self._is_undecided else ():
            assert self._hindsight is not None
            self._hindsight.saw(row)
        super()._saw(rows)

    def _predict(self, missing: int, drive: Sequence[int]) -> bool:
        """With the drive the board was last told to apply; of a single interval the samples that follow decide."""
        if missing == 1 and self._hindsight is not None:
            self._hindsight.gap(*self._state.shown)
        for _ in range(missing):
            ux, uy = self._observer.expected_drive()
            self._observer.tick(math.nan, math.nan, ux, uy)
            self._observer.withdraw()
        return missing == 1 or [round(code) for code in self._observer.expected_drive()] == list(drive)

    def _forget(self) -> None:
        if self._hindsight is not None:
            self._hindsight.forget()

    def _begin_again(self) -> None:
        self._shown.forget()

    def _heed(self, said: list[Message], newest_ns: int) -> None:
        super()._heed(said, newest_ns)
        if self._board.running is not None:
            self._shown.runs(self._board.running)


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
