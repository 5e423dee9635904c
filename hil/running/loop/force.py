"""Force mode: the host answers every sample with a drive.

What happens between a sample and its answer is one call into C (native/force.h).

Whether the drives that SENSE shows in force mode are the ones that were sent.

The observer takes the echo for what the board drives.  A board whose echo is something else makes the record wrong, and
may drive what nobody sent.  docs/wire.md, "What a host does", has the rule; native/echo.h judges by it.

Which drive acted while a sample was missing: decided by the samples that follow.

A lost sample takes the echo of its drive with it. The board was told one, but it held the one before if that frame was
lost as well. The difference shows in one sample no more than its noise, yet it turns the pattern by a milliradian that
would be taken for rotation. So for a while after a gap a second observer goes on as if the last drive had been held; if
the samples find that far likelier, it was.
"""

import copy
import ctypes
import math
from collections.abc import Sequence

from estimator.observer import Observer
from hil.plugins.plugged import Plugged
from hil.running.loop.skeleton import Loop, Setup
from hil.running.native import LIBRARY, NONE, EchoState, Mode
from hil.wire.messages import DriveForce, Message
from hil.wire.sense import SenseRow


class ForceLoop(Loop):
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
        if self.board.running is not None:
            self._shown.runs(self.board.running)


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


SAMPLES = 40
"""After a gap until it is decided; two cycles of a device sampled 20 times a cycle."""

MARGIN = 2.0 * math.log(99.0)
"""By which the second hypothesis must win, in units of the squared innovation: a frame in a hundred gets lost."""


class Hindsight:
    """Beside one observer, whose state it replaces when the other hypothesis wins."""

    def __init__(self, observer: Observer) -> None:
        self._told, self._held = observer, copy.deepcopy(observer)
        self._left = 0
        self._gain = 0.0

    @property
    def undecided(self) -> bool:
        """Whether it is to be told of each sample."""
        return self._left > 0

    def gap(self, ux: float, uy: float) -> None:
        """A sample is missing; the last drive echoed was `ux`, `uy`. Call it before the observer predicts over it."""
        self._decide()
        self._held.adopt(self._told)
        self._held.obey(self._told)
        self._held.tick(math.nan, math.nan, ux, uy)
        self._left, self._gain = SAMPLES, 0.0

    def saw(self, row: SenseRow) -> None:
        """The observer has had its tick with `row`."""
        if self._left:
            self._held.tick(row[1], row[2], row[3], row[4])
            self._gain += self._told.deviance - self._held.deviance
            self._left -= 1
            if not self._left:
                self._decide()

    def forget(self) -> None:
        """The motion is found anew: there is nothing to decide."""
        self._left, self._gain = 0, 0.0

    def _decide(self) -> None:
        if self._gain > MARGIN:
            self._told.adopt(self._held, commands=False)
        self.forget()
