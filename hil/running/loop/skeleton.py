"""What the loops of all modes have in common: the board armed and brought to SAFE, limits, gaps, counters.

The turn over samples is one call into C (`hil.running.loop.turn`); here is what Python sees to in between.  A mode adds
how C answers (`_bind`), how a gap is bridged (`_predict`), and what it forgets when the board was armed again
(`_begin_again`).  Nothing here stands between a sample and its answer.
"""

import math
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.observer import Estimates, Observer
from hil.bench import Bench
from hil.inputs.declared import drive_limit_of
from hil.numbers import count, counted, percent
from hil.records.estimates import packed
from hil.running.loop.target import TargetSteps
from hil.running.loop.trimming import Trimming
from hil.running.loop.turn import SEEN, Turn
from hil.running.native import ALWAYS, NONE, BlocksState, Mode, TurnState, Why
from hil.running.recording.angle import ReportedAngle
from hil.running.recording.recorder import RecorderError, Track
from hil.running.recording.tracks import estimate_rows, run_layouts
from hil.running.safety.armed import ArmedBoard, Pause
from hil.running.safety.latching import Safety
from hil.running.safety.opening import Opening
from hil.running.safety.trim_outputs import Output
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError, WireError
from hil.wire.messages import Identity, Message, SafeReason, Status
from hil.wire.sense import SenseRow

RESIDUAL_SAMPLES = 200  # over which the residual is averaged before it may stop the run
_LONG_GAP_S = 0.05  # beyond which the phase of the vibration is taken as lost
_AT_ONCE = 0.1  # of the time between two answers: samples that come within it had been waiting for this host
_FIRMWARE = "correct the board's firmware"
_AHEAD = 1.5  # by which a board's ticks may run ahead of this host's clock
NOTHING_WRITTEN: Mapping[str, float] = MappingProxyType({})


class BeyondLimits(WireError):
    """The control law gave drive codes that no board may be sent."""


class HostTooSlow(WireError):
    """A run on wall time lasts too long, and samples waited for this host most of the time: it is not the board's."""


@dataclass
class Counters:
    """What happened in a run, as far as only the loop sees it."""

    samples: int = 0
    lost: int = 0
    stopped: int = 0  # of these: the board was SAFE until it was armed again
    skipped: int = 0  # of these: the board streamed, and no missing frame accounts for them
    held: int = 0
    clipped: int = 0
    saturated: int = 0
    estimates: int = 0  # of the board's own, recorded
    rearmed: int = 0
    residual_safe: int = 0
    board: dict[str, int] = field(default_factory=dict)


def _nothing() -> None:
    """Where nobody wants to know."""


def _kept(name: str) -> Any:
    """A number that stands where the turn in C has it."""
    return property(lambda loop: getattr(loop._state, name), lambda loop, value: setattr(loop._state, name, value))


def _tick(name: str) -> Any:
    """A tick there, None before the first."""

    def get(loop: "Loop") -> int | None:
        value = int(getattr(loop._state, name))
        return None if value == NONE else value

    return property(get, lambda loop, value: setattr(loop._state, name, NONE if value is None else value))


def _flag(name: str) -> Any:
    """A truth there."""
    return property(
        lambda loop: bool(getattr(loop._state, name)), lambda loop, value: setattr(loop._state, name, int(value))
    )


class Setup(NamedTuple):
    """What a loop works with: the link, what the board says of itself, the bench, the observer, by stem where rows are
    recorded, registers that were written, and trim outputs.
    """

    endpoint: Endpoint
    identity: Identity
    bench: Bench
    observer: Observer
    tracks: Mapping[str, Track]
    registers: Mapping[str, float] = NOTHING_WRITTEN
    outputs: Sequence[Output] = ()


class Loop(ABC):
    """One run with one board; `registers` are what was written to it and read back, None of them where nothing was.

    Attributes:
        counters: kept up to date while the loop runs.
        between: called when something has come that is no sample, or nothing for a while.
        trouble: asked a few times a second what is wrong with the record, "" for nothing.
        stop: set (from a signal handler) to end the loop after the samples at hand.
        opening: the first rows of the run.
        wrong: why the loop ended itself before the first drive, "" if it did not.
        waker: descriptor that becomes readable when a signal has come, None for none.
        board: the board, as long as it is armed.
    """

    DRIVE: ClassVar[type[Message]]
    """What it sends a board to drive it."""
    MODE: ClassVar[Mode]

    stop: bool = _flag("stop")
    _first: int | None = _tick("first")
    _next: int | None = _tick("next")
    _answered_ns: int = _kept("answered_ns")
    _drives: int = _kept("drives")  # that were sent
    _turns: int = _kept("turns")  # in which samples came
    _behind: int = _kept("behind")  # of these: they were there already
    _residual: float = _kept("residual")
    _guarded: int = _kept("guarded")  # sample from which the residual may stop the run

    def __init__(self, setup: Setup, blocks: BlocksState | None = None) -> None:
        endpoint, identity, bench, observer, tracks, registers, outputs = setup
        rate = identity.tick_rate_Hz
        self._state = TurnState(first=NONE, next=NONE)
        self._endpoint = endpoint
        self._name = endpoint.link.name
        self._observer = observer
        self._tracks = tracks
        self._rate_Hz = rate
        self._limits = bench.limits
        self._duration_s = bench.loop.duration_s
        self._lockstep = bench.loop.clock == "lockstep"
        self._watchdog_ticks = round(registers["WATCHDOG_TICKS"])
        self._timeout_s = bench.link.timeout_s
        self.board = ArmedBoard(endpoint, identity, bench, self.DRIVE, registers)
        self._slice_s = self.board.slice_s
        self._suspicious_ns = self.board.account.suspicious_ns
        self._waiting = bench.controller.enabled  # to close the loop
        self._acquired = math.ceil(bench.observer.acquisition_s * rate)
        self.opening = Opening(bench, identity)
        self._opening: Opening | None = self.opening  # while it needs more
        self._step_target = TargetSteps(observer, bench)
        self._trimming = Trimming(endpoint, bench, observer, outputs, tracks.get("trims"))
        self._long_gap = max(round(_LONG_GAP_S * rate), 2)
        safe = bench.limits.residual_safe
        self._state.residual_limit = safe * safe  # ** refuses what overflows
        self._residual = 1.0
        self._pause: Pause | None = None  # of the board, until a row comes from after it
        self._begun_ns = self._answered_ns = self._listened_ns = time.monotonic_ns()
        self._block = bench.loop.rows
        self._goal = 0  # ticks of the run at which somebody wants to be told
        self._excused = 0  # ticks missing around a stop, beside those of it
        self._missing_before = self._missing_frames()
        self.counters = Counters()
        self.between: Callable[[], None] = _nothing  # by name, so that a loop at rest can be pickled
        self.trouble: Callable[[], str] = str
        self.wrong = ""
        self.waker: int | None = None
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
        state.suspicious_ns, state.at_once_ns = self._suspicious_ns, round(1e9 * _AT_ONCE * self._block / rate)
        state.estimate_every = bench.loop.estimate_every
        state.covariance_every = bench.loop.covariance_stride(rate) if self._observer.HAS_COVARIANCE else ALWAYS
        for axis in range(2):
            volts = self._observer.volts[axis]
            state.volts[axis] = volts
            state.noise[axis] = bench.device.sense.noise_V / abs(volts)

    @property
    def safety(self) -> Safety:
        return self.board.safety

    @property
    def newest(self) -> int | None:
        """Tick of the last sample that was answered, None before the first."""
        return None if self._next is None else self._next - 1

    def arm(self) -> Status:
        """ARM; `finish` has to follow, whatever comes. Raises as `ArmedBoard.arm`."""
        return self.board.arm()

    def run(self, samples: int, report: Callable[[int], None], report_every: int) -> None:
        """Answer `samples` samples (their ticks, gaps included); `report` is told how many are done.

        Raises LinkClosed when the board hangs up, ProtocolError when it falls silent, stops, or lets the run take too
        long, HostTooSlow where this host does, RecorderError when the record ended.
        """
        self._observer.enable_control(False)
        self._guarded = self._acquired + RESIDUAL_SAMPLES
        self._first = None
        self._begun_ns = self._answered_ns = self._listened_ns = time.monotonic_ns()
        self.go_on(samples, report, report_every)

    def go_on(self, samples: int, report: Callable[[int], None], report_every: int) -> None:
        """The rest of what `run` began, of `samples` samples in all; raises as `run`."""
        done = reported = self._done
        while done < samples and not self.stop:
            self._goal = min(reported + report_every, samples)
            taken = self._turn()
            if not taken:
                self._attend()
                continue
            done = taken
            if done - reported >= report_every:
                reported = done
                self._see_to_it()
                report(done)

    def finish(self, reason: SafeReason) -> None:
        """SAFE, and the board's own counters. Nothing where ARM was never sent; raises nothing that the link does."""
        self.board.newest = self.newest
        if skipped := self.counters.skipped:
            self.safety.odd.append(
                f"its ticks left out {count(skipped)} for which no frame is missing: they do not count samples"
            )
        self.counters.board = self.board.to_safe(reason)

    def _turn(self) -> int:
        """Wait for samples, `_slice_s` at most, and answer them; how many ticks of the run are done, 0 if none came.

        It may go on with the samples that follow until `_goal` ticks are done.
        """
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
        state = self._state
        state.goal = self._goal
        if self._pause is not None and self._next is not None and self._next - 1 > self._pause.armed:
            self._pause = None
        state.stale = NONE if self._pause is None else self._pause.safe
        state.link.waker = -1 if self.waker is None else self.waker
        state.held_longest, state.held_run, state.held_next = self.board.account.held
        due = [one.due for one in (self._step_target, self._trimming) if one.due is not None]
        state.due = min([*due, self._close_at if self._waiting else ALWAYS])
        state.look_after = self._may_look_after()

    def _take_back(self) -> None:
        state, counters, account = self._state, self.counters, self.board.account
        for name in ("samples", "held", "clipped", "saturated", "residual_safe"):
            setattr(counters, name, getattr(state, name))
        account.held = state.held_longest, state.held_run, state.held_next
        if state.silence_ns:
            account.silent(state.silence_ns)
            state.silence_ns = 0

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

    def _full(self) -> None:  # noqa: B027
        """Make room for what is not taken back anyway."""

    def _heard(self) -> None:  # noqa: B027
        """Something has come that is no sample."""

    @abstractmethod
    def _predict(self, missing: int, drive: Sequence[int]) -> bool:
        """Predict over a short gap before the sample at hand; whether `drive`, which acted last, was to be expected."""

    @abstractmethod
    def _forget(self) -> None:
        """The phase of the vibration is lost."""

    @abstractmethod
    def _begin_again(self) -> None:
        """The board was armed again."""

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
        self._observer.enable_control(True)

    def _saw(self, rows: list[SenseRow]) -> None:
        """Rows that C has answered and recorded."""
        if self._opening is not None:
            self._look(rows)

    def _record(self, ticks: NDArray[np.int64], estimates: Estimates) -> None:
        self._tracks["estimates"].push(estimate_rows(self._layouts["estimates"], ticks, estimates, self._reported))

    def _record_covariance(self, tick: int, covariance: NDArray[np.float64]) -> None:
        self._tracks["covariance"].put(tick, *packed(covariance))

    def _said(self) -> list[Message]:
        """What the board has said beside samples since this was last asked."""
        return self._endpoint.said()

    def _may_close(self, since: int) -> bool:
        """Whether the loop is to be closed with the sample that many ticks from the first: the motion is acquired, and
        the sense levels were judged and are right, however few rows came of those ticks.
        """
        return since >= self._acquired and self.opening.judged and not self.wrong

    def _bridge(self, tick: int, drive: Sequence[int]) -> None:
        """See to the samples that are missing before that of `tick`, which tells that `drive` acted last.

        The board goes by its model where it did what it was told. It did not where it stopped meanwhile, or holds
        another drive than it was sent: then nobody knows how it moved.
        """
        missing = 0 if self._next is None else tick - self._next
        if missing < 0:
            raise ProtocolError(
                f"{self._name}: the board's tick went back from {tick - missing - 1} to {tick}; did it restart?"
            )
        # Whatever tick the board gave when it was armed again: it stood in SAFE between these two rows.
        through_stop = missing > 0 and self._pause is not None and tick > self._pause.safe
        stopped = self._paused(tick)
        if through_stop:  # the block under way need not have been sent, nor are the board's ticks its own there
            self._excused += missing - stopped
        if missing:
            self._require_possible(tick, missing, stopped)
        self.counters.lost += missing
        self.counters.stopped += stopped
        if missing > self._long_gap or through_stop:
            self._forget()
            self._observer.lose_phase(missing)
        elif not missing or self._predict(missing, drive):
            return
        else:
            self._forget()
            self._observer.lose_motion()
        self._guarded = self.counters.samples + self.counters.lost + RESIDUAL_SAMPLES
        self._residual = 1.0

    def _paused(self, tick: int) -> int:
        """How many of the samples that are missing before that of `tick` are so because the board was SAFE.

        Rows from before the stop may come after the board was armed again: what is missing before them is not.
        """
        pause = self._pause
        if pause is None or self._next is None:
            return 0
        if tick > pause.armed:
            self._pause = None
        return max(min(tick - 1, pause.armed) + 1 - self._next, 0) if tick - 1 > pause.safe else 0

    def _require_possible(self, tick: int, missing: int, stopped: int) -> None:
        """See to ticks that cannot have passed, of `missing` ones before `tick`, `stopped` of them in SAFE.

        Each tick of a board that streams has its row in a frame with a number: those that are missing bound the rows
        that are.  Few beyond that are counted; many, and any in lockstep, raise ProtocolError.  In lockstep a board
        goes on by a block for each drive; on wall time no further than time has.
        """
        assert self._first is not None
        counters, before = self.counters, tick - missing - 1
        frames = self._missing_frames() - self._missing_before
        streamed = counters.lost - counters.stopped + missing - stopped
        accounted = frames * self._block + self._excused
        skipped = streamed - accounted - counters.skipped
        if skipped > 0:
            counters.skipped += skipped
        if skipped > (0 if self._lockstep else self._long_gap):
            raise ProtocolError(
                f"{self._name}: the board's tick jumped from {before} to {tick}, of which no frame is missing for "
                f"{count(skipped)}",
                _FIRMWARE,
            )
        if self._lockstep:
            # An emulated line that loses a frame lets its tick pass without an answer, as it would on wall time; a
            # board that gets none for as long as its watchdog waits is SAFE.
            unanswered = missing - stopped > self._watchdog_ticks
            if not counters.rearmed and (unanswered or tick - self._first > (self._drives + frames) * self._block):
                raise ProtocolError(
                    f"{self._name}: the board's tick jumped from {before} to {tick} in lockstep, after "
                    f"{counted(self._drives, 'drive')}, each of which lets it go on by {self._block}",
                    _FIRMWARE,
                )
            return
        elapsed_s = 1e-9 * (time.monotonic_ns() - self._begun_ns)
        if missing > self._long_gap and (tick - self._first) / self._rate_Hz > _AHEAD * elapsed_s + 1.0:
            raise ProtocolError(
                f"{self._name}: the board's tick jumped from {before} to {tick}, {elapsed_s:.3g} s after ARM, which is "
                f"{count(round(elapsed_s * self._rate_Hz))} ticks",
                _FIRMWARE,
            )

    def _missing_frames(self) -> int:
        """Frames that did not come, or of which nothing was taken; each may have been a block of rows."""
        rx = self._endpoint.rx
        return rx.lost + rx.undecodable + rx.repeated + self._endpoint.forgotten

    def _look(self, rows: Iterable[Sequence[int]]) -> None:
        """The first rows, until there are enough."""
        assert self._opening is not None
        if self._opening.saw(rows):
            self._opening = None
        self.wrong = self.opening.wrong
        self.stop = self.stop or bool(self.wrong)

    def _attend(self) -> None:
        """No sample came: see to the board, and to all else."""
        now_ns = time.monotonic_ns()
        # A host that listens, and is sent no sample, is not the one that was silent.
        if now_ns - max(self._answered_ns, self._listened_ns) > self._suspicious_ns + 1e9 * self._slice_s:
            self.board.account.silent(now_ns - self._answered_ns)
        self._listened_ns = now_ns
        self._heed(self._said(), self._answered_ns)
        self.between()

    def _wake(self) -> None:
        """A signal has come, and its handler has run by now."""
        if self.waker is not None:
            with suppress(BlockingIOError):
                os.read(self.waker, 64)

    def _see_to_it(self) -> None:
        """Now and then while samples come: the record, the time, and what the board says beside them."""
        self._require_recorder()
        if said := self._said():
            self._heed(said, time.monotonic_ns())  # if anything stood still since the last sample, it was not the board

    def _heed(self, said: list[Message], newest_ns: int) -> None:
        self._require_recorder()
        self._require_time()
        self.board.newest = self.newest
        if pause := self.board.attend(said, newest_ns):
            self.counters.rearmed += 1
            self._pause = pause
            self._answered_ns = time.monotonic_ns()
            self._trimming.stopped(pause.safe)
            self._begin_again()

    def _require_recorder(self) -> None:
        if trouble := self.trouble():
            raise RecorderError(trouble)

    def _require_time(self) -> None:
        """ProtocolError when a run on wall time lasts too long; HostTooSlow where samples wait for this host."""
        if self._lockstep:
            return
        elapsed_s = 1e-9 * (time.monotonic_ns() - self._begun_ns)
        if elapsed_s > (bound_s := (1.0 + self._limits.overtime) * self._duration_s + self._timeout_s):
            told = (
                f"the run of {self._duration_s:g} s was not over after {bound_s:.3g} s, [limits] overtime is "
                f"{self._limits.overtime:g}"
            )
            if 2 * self._behind > self._turns:
                share = percent(self._behind / self._turns, 0)
                raise HostTooSlow(
                    f"{told}; this host is too slow: samples were waiting in {share} of the loop iterations"
                )
            raise ProtocolError(f"{self._name}: {told}; the board's ticks, or the way from it, are too slow")
