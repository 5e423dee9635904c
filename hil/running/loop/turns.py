"""A loop whose turn is one call into C (`hil.running.loop.turn`), and what Python sees to in between: gaps, the closing
of the loop, steps of the target, the first rows, what is recorded more seldom.
"""

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from estimator.observer import Estimates
from hil.bench import Bench
from hil.inputs.declared import drive_limit_of
from hil.running.loop.skeleton import BeyondLimits, Loop, Setup
from hil.running.loop.turn import SEEN, Turn
from hil.running.native import ALWAYS, NONE, BlocksState, Mode, Why
from hil.running.recording.angle import ReportedAngle
from hil.running.recording.tracks import estimate_rows, put_covariance, run_layouts
from hil.wire.errors import ProtocolError
from hil.wire.messages import Identity, Message
from hil.wire.sense import SenseRow


class TurnLoop(Loop):
    """One run; a mode adds how C answers, and what Python has to do with it."""

    MODE: Mode

    def __init__(self, setup: Setup, blocks: BlocksState | None = None) -> None:
        super().__init__(setup)
        endpoint, identity, bench, observer, tracks = setup[:5]
        self._layouts = run_layouts(observer, bench, identity)
        self._reported = ReportedAngle(bench)
        self._drive_limit = drive_limit_of(bench, identity)
        self._c = Turn(self._state, endpoint, observer, tracks, self._layouts, self._bind, blocks)
        self._c.estimates, self._c.covariance, self._c.seen = self._record, self._record_covariance, self._saw
        self._close_at = self._acquired  # sample from the first before which the loop may be closed
        self._declare(identity, bench)

    def _declare(self, identity: Identity, bench: Bench) -> None:
        """What C needs to know of the run, once."""
        state, rate = self._state, self._rate_Hz
        state.mode = self.MODE
        state.latency, state.code_limit = identity.latency_ticks, self._drive_limit
        state.lockstep = self._lockstep
        state.slice_ns = round(1e9 * self._slice_s)
        state.suspicious_ns, state.at_once_ns = self._suspicious_ns, self._at_once_ns
        state.estimate_every = bench.loop.estimate_every
        state.covariance_every = bench.loop.covariance_stride(rate) if self._observer.HAS_COVARIANCE else ALWAYS
        for axis in range(2):
            volts = self._observer.volts[axis]
            state.volts[axis] = volts
            state.noise[axis] = bench.device.sense.noise_V / abs(volts)

    @abstractmethod
    def _bind(self) -> None:
        """Put the addresses of what the mode has into `_state`."""

    @abstractmethod
    def _odd(self) -> str:
        """In words what the board shows that it was not told."""

    @abstractmethod
    def _refused(self) -> str:
        """In words what the control law gave that may not be sent."""

    def _may_look_after(self) -> int:
        """Rows after which somebody wants to look at them."""
        return ALWAYS if self._opening is None else min(self._opening.lacking, SEEN)

    def _full(self) -> None:
        """Make room for what is not taken back anyway."""

    def _heard(self) -> None:
        """Something has come that is no sample."""

    def _turn(self) -> int:
        while True:
            self._lend()
            why = self._c.run()
            self._take_back()
            match why:
                case Why.NEWS:
                    self._heard()
                    return self._done
                case Why.DONE:
                    return self._done
                case Why.QUIET:
                    return 0
                case Why.WOKEN:
                    self._wake()
                    return 0
                case Why.GAP:
                    row = self._c.row
                    self._bridge(row[0], row[3:5])
                    self._next = row[0]
                case Why.DUE:
                    self._see_to_control(self._c.row[0])
                case Why.FULL:
                    self._full()
                case Why.ODD:
                    raise ProtocolError(f"{self._name}: {self._odd()}", "correct the board's firmware")
                case Why.BEYOND:
                    raise BeyondLimits(f"{self._refused()}: nothing was sent; check the observer")

    @property
    def _done(self) -> int:
        return 0 if self._next is None or self._first is None else self._next - self._first

    def _lend(self) -> None:
        """What may have changed since C last ran."""
        state = self._state
        state.goal = self._goal
        if self._pause is not None and self._next is not None and self._next - 1 > self._pause.armed:
            self._pause = None
        state.stale = NONE if self._pause is None else self._pause.safe
        state.link.waker = -1 if self.waker is None else self.waker
        held, run, following = self._board.account.held_so_far
        state.held_longest, state.held_run, state.held_next = held, run, NONE if following is None else following
        due = [one.due for one in (self._step_target, self._trimming) if one.due is not None]
        state.due = min([*due, self._close_at if self._waiting else ALWAYS])
        state.look_after = self._may_look_after()

    def _take_back(self) -> None:
        """What C has counted."""
        state, counters, account = self._state, self.counters, self._board.account
        for name in ("samples", "held", "clipped", "saturated", "residual_safe"):
            setattr(counters, name, getattr(state, name))
        following = None if state.held_next == NONE else state.held_next
        account.held_so_far = state.held_longest, state.held_run, following
        if state.silence_ns:
            account.silent(state.silence_ns)
            state.silence_ns = 0

    def _see_to_control(self, tick: int) -> None:
        """Close the loop, or move its target, before the sample of `tick`."""
        assert self._first is not None
        since = tick - self._first
        self._close_at = max(since + 1, self._acquired)
        if self._waiting and self._may_close(since):
            self._waiting = False
            self._close()
        self._step_target(since)
        self._trimming(since, tick, closed=not self._waiting)

    def _close(self) -> None:
        """Close the loop, from the next answer on."""
        self._observer.enable_control(True)

    def _saw(self, rows: list[SenseRow]) -> None:
        """Rows that C has answered and recorded."""
        if self._opening is not None:
            self._look(rows)

    def _record(self, ticks: NDArray[np.int64], estimates: Estimates) -> None:
        self._tracks["estimates"].push(estimate_rows(self._layouts["estimates"], ticks, estimates, self._reported))

    def _record_covariance(self, tick: int, covariance: NDArray[np.float64]) -> None:
        put_covariance(self._tracks["covariance"], tick, covariance)

    def _said(self) -> list[Message]:
        return self._endpoint.said()
