"""The armed board at the other end while a loop runs: armed, seen to when no samples come, and brought to SAFE at the
end.

A stop that this host did not want ends the run, unless it is one that does not latch and that the host can account for;
then the board is armed again, a few times at most.  docs/safety.md has the rules.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import NamedTuple, NoReturn

from hil.bench import Bench
from hil.numbers import counted
from hil.running.native import NONE
from hil.running.safety.asked_again import ask_again, zero_drive
from hil.running.safety.latching import LATCHING, Safety, Stop, reason_name
from hil.running.safety.preflight import require_unchanged
from hil.running.safety.stopping import bring_to_safe
from hil.wire import client
from hil.wire.codec import type_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkError, ProtocolError, WireError
from hil.wire.messages import (
    DriveForce,
    Identity,
    Message,
    Nack,
    NackReason,
    RegisterRead,
    SafeReason,
    State,
    Status,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from hil.wire.stream import unwrap

SLICE_S = 0.25
"""Longest wait for samples at a time: how soon the loop sees to what is not a sample."""

_ROOM = 16  # drives that a board has room for in force mode, at least
_COUNTERS = ("late", "held", "bad_frames", "lost_seq", "saturated", "watchdog_trips", "dropped")
_STATES = frozenset(map(int, State))
_STREAMING = (State.ARMED, State.RUNNING)
_ARM_REFUSED = {
    "LATCHED": "its own protection (FAULT) has tripped, or a stop latched; find the cause",
    "BAD_STATE": "it was not greeted since its start; if it restarted, check the board's supply",
    "NOT_SUPPORTED": "it cannot run like this; a board without latency needs lockstep or gain mode",
    "OUT_OF_RANGE": "a register does not suit it; look at [loop] filter",
}


class Pause(NamedTuple):
    """Ticks between which the board was SAFE: that of the STATUS which said so, and that of the one which answered ARM.

    Rows up to `safe`, and the rest of a block that was under way then, are from before the stop, whenever they come.
    """

    safe: int
    armed: int


def _unheard(_: object) -> None:
    """Where nobody listens."""


class ArmedBoard:
    """`drive` is the message that closes the loop.

    Silence, which counts from the last accepted row, is borne for `[link] timeout_s`.  In lockstep a board that says
    nothing at all may stand in a debugger: it is waited for, up to `[limits] standstill_s`; one that answers a question
    and sends no row is not.

    Attributes:
        safety: what there is to say of the board's stops.
        account: what the host knows of its own silences.
        newest: tick of the last row, for the loop to set before it asks for anything; None before the first.
        running: tick at which the board said RUNNING; None since ARM.
        waiting: told now and then for how many seconds a board has been waited for.
        answered: told the STATUS by which the board answers the last SAFE, as soon as it is there.
    """

    def __init__(
        self, endpoint: Endpoint, identity: Identity, bench: Bench, drive: type[Message], registers: Mapping[str, float]
    ) -> None:
        self._endpoint = endpoint
        self._name = endpoint.link.name
        self._drive = type_of(drive)
        self._probe = partial(zero_drive, drive)
        self._registers = registers
        self._silence_s = bench.link.timeout_s
        self._patient = bench.loop.clock == "lockstep" and endpoint.link.fileno() is not None
        self._standstill_s = bench.limits.standstill_s
        self._rearm = bench.limits.rearm
        self._rate_Hz = identity.tick_rate_Hz
        self._latency = identity.latency_ticks
        self._block = bench.loop.rows
        ticks = round(registers["WATCHDOG_TICKS"])
        self._asked_ns = 0
        self._safe_sent = False
        self.slice_s = min(SLICE_S, 0.25 * self._silence_s)
        self.account = Account(endpoint, ticks, self._block, self._rate_Hz, identity.latency_ticks)
        self.safety = Safety()
        self.newest: int | None = None
        self.running: int | None = None
        self._refusals: Counter[int] = Counter()  # of drives, by reason, since ARM
        self._refused_before: tuple[Counter[tuple[int, int]], int] = Counter(), 0
        self.waiting: Callable[[float], None] = _unheard  # by name, so that it can be pickled
        self.answered: Callable[[Status], None] = _unheard

    def arm(self) -> Status:
        """ARM; what the board says to it. From its first byte on it has to be brought to SAFE: see `to_safe`.

        Raises ProtocolError when the board refuses, LinkError when it does not answer.
        """
        self._endpoint.said()  # the second answer to a HELLO that had to be repeated, and whatever else is past
        self.safety.armed = True
        self._refused_before = self._endpoint.refusals.copy(), self._endpoint.unsent
        status = self._arm()
        self.safety.taken = True
        self.account.begin(status)
        return status

    def attend(self, said: Iterable[Message], newest_ns: int) -> Pause | None:
        """See to what the board has said beside samples, the last of which came at `newest_ns`; when it was SAFE, if
        it was armed again.

        Raises ProtocolError where the run is over: the board stopped for a reason that latches or that nobody accounts
        for, restarted, or fell silent.
        """
        status = self._stopped(said)
        if status is None:
            status = self._missed(newest_ns)
        if status is None:
            return None
        asked, self._safe_sent = self._safe_sent, False
        stop = self._note(status, "host" if asked and status.reason == SafeReason.LINK_LOST else "board")
        try:
            armed = self._recover(status, stop, asked=asked)
        except WireError:  # whatever the board says, for this host the stop has latched
            self.safety.latched = self.safety.latched or stop.reason
            raise
        return Pause(stop.tick, unwrap(armed.tick, self._endpoint.rx.tick))

    def to_safe(self, reason: SafeReason) -> dict[str, int]:
        """Bring the board to SAFE if it may be armed; its own counters, by name, none when it does not answer."""
        if not self.safety.armed:
            return {}
        self.safety.odd.extend(self._unasked())
        stopped = bring_to_safe(
            self._endpoint,
            reason,
            self._silence_s,
            rate_Hz=self._rate_Hz,
            block=self._block,
            newest=self.newest,
            answered=self.answered,
        )
        self.safety.confirmed, self.safety.words = stopped.confirmed, stopped.why
        status = stopped.status
        if status is None:
            return {}
        self.safety.confirmed_tick = unwrap(status.tick, self._endpoint.rx.tick)
        if stopped.confirmed:
            asked = ask_again(self._endpoint, self._probe(self._endpoint.rx.tick), self._registers, self._silence_s)
            self.safety.odd.extend(asked.odd)
            if asked.drives:
                self.safety.confirmed, self.safety.words = False, f"STATUS says SAFE, yet {asked.drives}"
        if status.reason == SafeReason.FAULT and self.safety.latched != "FAULT":
            self._note(status, "board")  # it tripped while it was told to stop
            self.safety.latched = "FAULT"
        return {name: getattr(status, name) for name in _COUNTERS}

    def _unasked(self) -> list[str]:
        """Refusals since ARM that no board says which keeps to the page, one clause each.

        A drive that was under way when the board stopped is refused, and in force mode one that finds no room to wait:
        there are 16 places at least.
        """
        before, unsent = self._refused_before
        odd = []
        if (count := self._endpoint.unsent - unsent) > 0:
            odd.append(f"it refused {counted(count, 'frame')} that this host had not sent")
        for (kind, reason), total in (self._endpoint.refusals - before).items():
            stopped = kind == self._drive and reason == NackReason.BAD_STATE and self.safety.stops
            full = reason == NackReason.OUT_OF_RANGE and kind == type_of(DriveForce) and self._latency >= _ROOM
            if not (stopped or full):
                name = f"{SPEC.message_name(kind)}, {client.nack_name(reason)}"
                odd.append(f"it refused {counted(total, 'frame')} as no board does that keeps to the page ({name})")
        return odd

    def _stopped(self, said: Iterable[Message]) -> Status | None:
        """STATUS of a board that has stopped, by what it has said."""
        stopped: Status | None = None
        refused = False
        for message in said:
            if isinstance(message, Identity):
                self._end(
                    "the board said IDENTITY, which answers HELLO, and this host said none",
                    "see that no other host greets the board",
                )
            if isinstance(message, Status):
                if message.state not in _STATES:
                    self._end(
                        f"STATUS gives state {message.state}, which is not listed", "correct the board's firmware"
                    )
                if message.state == State.RUNNING:
                    self.running = unwrap(message.tick, self._endpoint.rx.tick)
                stopped = None if message.state in _STREAMING else message
                refused = refused and stopped is not None
            elif isinstance(message, Nack) and message.of_type == self._drive:
                if message.reason == NackReason.BAD_STATE:  # the STATUS was lost, but the board refuses to be driven
                    refused = True
                else:
                    self._refusals[message.reason] += 1
        if stopped is None and refused:
            return self._ask_safe(self._silence_s)
        return stopped

    def _ask_safe(self, patience_s: float) -> Status:
        """STATUS of a board that is told SAFE for a reason which does not latch, and does not cover one that does."""
        try:
            status = client.make_safe(self._endpoint, SafeReason.LINK_LOST, patience_s)
        except LinkError:
            raise ProtocolError(
                f"{self._name}: the board fell silent for {self._silence_s:g} s",
                "check the board's supply and the cable",
            ) from None
        self._safe_sent = True
        return status

    def _missed(self, newest_ns: int) -> Status | None:
        """Whether rows are missing for too long: STATUS of a board that was told to be SAFE for it, and is."""
        silent_s = 1e-9 * (time.monotonic_ns() - newest_ns)
        if not self._patient:
            return self._ask_safe(0.5 * self._silence_s) if silent_s >= 0.5 * self._silence_s else None
        if silent_s < self._silence_s:
            return None
        now_ns = time.monotonic_ns()
        if self._endpoint.received_ns > self._asked_ns > newest_ns:  # it answered, and sent no row
            return self._ask_safe(self._silence_s)
        if silent_s >= self._standstill_s:
            raise ProtocolError(
                f"{self._name}: the board has said nothing for {silent_s:.0f} s ([limits] standstill_s = "
                f"{self._standstill_s:g})",
                "check the board's supply and the cable",
            )
        if now_ns - self._asked_ns >= 1e9 * self._silence_s:
            self._asked_ns = now_ns
            self._endpoint.send(RegisterRead(SPEC.registers["CLOCK_MODE"].id))
            self.waiting(silent_s)
        return None

    def _recover(self, status: Status, stop: Stop, *, asked: bool) -> Status:
        """Arm a board again that has stopped, or raise ProtocolError; `asked`: whether this host told it to be SAFE.
        What it says to ARM.
        """
        if status.state != State.SAFE:
            self._end(f"the board restarted: it is in {State(status.state).name}", "check the board's supply")
        if status.reason in LATCHING or status.reason not in (SafeReason.WATCHDOG, SafeReason.LINK_LOST):
            self._latch(stop, status.reason)
        if status.reason == SafeReason.WATCHDOG:
            stop.account = self.account.of_watchdog(status)
            why, cure = (
                f"its watchdog tripped, yet {self.account.words}",
                "check WATCHDOG_TICKS and the board's receiver",
            )
            if self.account.refused or self._unsampled(stop):
                why, cure = self._unacceptable()
        elif asked:
            stop.account = self.account.of_silence(status)
            why, cure = self._unacceptable()
        else:
            why, cure = "the link was lost, it says", "see that no other host greets the board"
        # A restart looks like a silence, too, and says more.
        require_unchanged(self._endpoint, self._registers, self._silence_s)
        if not stop.account:
            self._end(f"the board went to SAFE: {why}", cure)
        if self.safety.rearmed >= self._rearm:
            self._end(
                f"the board went to SAFE once more ({stop.reason}: {stop.account}) after it was armed again "
                f"{self.safety.rearmed} times, [limits] rearm is {self._rearm}",
                f"measure the way to the board: hil doctor --link {self._name}",
            )
        armed = self._arm()
        self.account.begin(armed)
        self.heard()  # refusals from before it was armed
        stop.armed_again = True
        self.safety.rearmed += 1
        return armed

    def _unsampled(self, stop: Stop) -> bool:
        """Whether the board sent nothing to answer for most of its watchdog, by its own ticks: one that lags behind the
        time catches up in no time. Where it only gets no drive, the last row is a block old at most, and a watchdog
        three blocks long."""
        return self.newest is None or stop.tick - self.newest >= 0.5 * self._registers["WATCHDOG_TICKS"]

    def _unacceptable(self) -> tuple[str, str]:
        """Why a board that answers was told to stop, and what to do about it."""
        what, cure = "nothing was lost on the way", "check the board's SENSE"
        if self._refusals:
            reason, times = self._refusals.most_common(1)[0]
            what = f"it refused {times} drives, {client.nack_name(reason)}"
        elif refused := self.account.refused:
            what = f"{refused} frames were unknown or contradicted themselves"
        elif repeated := self.account.repeated:
            what = f"{repeated} frames repeated a sequence number"
            cure = "check that the board's sequence counter goes to 65535"
        return f"it answers, but sends no acceptable sample ({what})", cure

    def _latch(self, stop: Stop, reason: int) -> NoReturn:
        if reason == SafeReason.FAULT:
            what = f"the board stopped itself{self._when(stop)}: FAULT, its own protection tripped"
        elif reason in LATCHING:
            stop.by = "another node"
            what = f"another node stopped the board{self._when(stop)}: {stop.reason}"
        else:
            what = f"the board stopped{self._when(stop)} and gives {stop.reason}"
        self._end(f"{what}; find the cause before it is armed again")

    def _end(self, what: str, cure: str = "") -> NoReturn:
        raise ProtocolError(f"{self._name}: {what}", cure)

    def _note(self, status: Status, by: str) -> Stop:
        stop = Stop(reason_name(status.reason), by, unwrap(status.tick, self._endpoint.rx.tick))
        self.safety.stops.append(stop)
        return stop

    def _when(self, stop: Stop) -> str:
        return f" at tick {stop.tick} ({stop.tick / self._rate_Hz:.3f} s)"

    def heard(self) -> list[Message]:
        """What the board has said beside samples, which stay for the loop."""
        items = self._endpoint.poll(0.0)
        self._endpoint.keep([item for item in items if isinstance(item.message, Sense)])
        return [item.message for item in items]

    def _arm(self) -> Status:
        self.running = None
        self._refusals.clear()
        try:
            return client.arm(self._endpoint, self._silence_s)
        except client.Refused as refusal:
            names = {member.value: member.name for member in NackReason}
            what = _ARM_REFUSED.get(names.get(refusal.reason, ""), "")
            raise ProtocolError(str(refusal), what) from None


class Account:
    """Kept for a board that goes SAFE after `watchdog_ticks` without a drive; answers come every `block` ticks.

    Attributes:
        suspicious_ns: a time between two answers from which on `silent` is to be told.
        held: the longest run of rows without a drive, the one under way, and the tick with which it goes on.
    """

    def __init__(self, endpoint: Endpoint, watchdog_ticks: int, block: int, rate_Hz: float, latency: int) -> None:
        self._endpoint = endpoint
        self._watchdog_s = watchdog_ticks / rate_Hz
        # The board counts from when it has the last drive to when it has the next: neither end sees the same time.
        self.suspicious_ns = round(1e9 * max(watchdog_ticks - 2 * block, 0.5 * watchdog_ticks) / rate_Hz)
        self._held_ticks = max(watchdog_ticks - 2 - latency, 1)
        self.begin(None)

    def begin(self, status: Status | None) -> None:
        """The board has been armed and said `status`: what comes from now on counts."""
        rx = self._endpoint.rx
        self._base = rx.lost, rx.decoder.bad, self._missed(status)
        self._refused, self._repeated = rx.undecodable, rx.repeated
        self._silent_ns = 0
        self.held = 0, 0, NONE

    def silent(self, elapsed_ns: int) -> None:
        """So long passed between two answers of this host."""
        self._silent_ns = max(self._silent_ns, elapsed_ns)

    @property
    def refused(self) -> int:
        """Intact frames that no host could take; their sender keeps this host silent."""
        return self._endpoint.rx.undecodable - self._refused

    @property
    def repeated(self) -> int:
        """Frames that were dropped because their number had passed."""
        return self._endpoint.rx.repeated - self._repeated

    def of_silence(self, status: Status | None) -> str:
        """What accounts for samples that stopped coming: frames that were lost or damaged on the line."""
        rx = self._endpoint.rx
        lost, damaged, missed = self._base
        missed = max(self._missed(status) - missed, 0) if status is not None else 0
        lost, damaged = rx.lost - lost, rx.decoder.bad - damaged
        if lost + damaged + missed == 0:
            return ""
        return f"{lost + damaged} frames to the host and {missed} to the board were lost or damaged"

    def of_watchdog(self, status: Status | None) -> str:
        """What accounts for a watchdog that tripped."""
        if not self.refused and self._silent_ns >= self.suspicious_ns:
            return f"this host sent nothing for {1e-9 * self._silent_ns:.3g} s"
        if self.held[0] >= self._held_ticks:
            return f"answers were late on {self.held[0]} ticks running"
        return self.of_silence(status)

    @property
    def words(self) -> str:
        """What this host can say in its own favour."""
        longest = f"never silent for longer than {1e-9 * self._silent_ns:.3g} s" if self._silent_ns else "never late"
        return f"this host was {longest}, watchdog {self._watchdog_s:g} s, and no frame was lost"

    @staticmethod
    def _missed(status: Status | None) -> int:
        return 0 if status is None else status.lost_seq + status.bad_frames
