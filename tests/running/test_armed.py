"""docs/safety.md, The host, rules 4 and 6 to 8: which boards are armed again, how often, and what ends a run.

Over a pty, without a loop: the board's end says what the rule is about, and nothing else.
"""

import time
from collections.abc import Iterator
from typing import Any

import pytest

from hil.running.safety.armed import ArmedBoard
from hil.running.safety.stopping import Stopped
from hil.wire.codec import type_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkError, ProtocolError
from hil.wire.link import Link
from hil.wire.messages import (
    Arm,
    DriveForce,
    Message,
    Nack,
    NackReason,
    RegisterRead,
    RegisterValue,
    RegisterWrite,
    Safe,
    SafeReason,
    State,
    Status,
)
from hil.wire.spec import SPEC
from tests.running import gyro
from tests.running.misbehaving import Board
from tests.running.on_a_pty import Far, arrived, connected, rows, status

TICK, WATCHDOG, TIMEOUT_S, REARM = 480, 200, 0.4, 2
WATCHDOG_NS = round(1e9 * WATCHDOG / 400.0)
WRITTEN = {"CLOCK_MODE": 1.0, "WATCHDOG_TICKS": float(WATCHDOG), "DRIVE_LIMIT": 1000.0, "SESSION": 4711.0}
LATCHING = [SafeReason.HOST_REQUEST, SafeReason.INTERRUPTED, SafeReason.RESIDUAL, SafeReason.FAULT]


class Armed:
    """Both ends; the board's keeps to the page, but for what a test sets.

    Attributes:
        reads: its registers, as it answers when asked.
        to_arm, to_safe: what it answers.
    """

    def __init__(self, host: Endpoint, far: Far, clock: str = "paced", **limits: Any) -> None:
        self.host, self.far = host, far
        far.tick = TICK
        self.reads = {SPEC.registers[name].id: value for name, value in WRITTEN.items()}
        self.to_arm: Message = status(State.ARMED, SafeReason.NONE, tick=TICK)
        self.to_safe: list[Message] = [status(reason=SafeReason.LINK_LOST, tick=TICK)]
        link = {"timeout_s": TIMEOUT_S, "watchdog_s": WATCHDOG / 400.0}
        bench = gyro.unhurried_bench(1.0, clock, link=link, limits={"rearm": REARM} | limits)
        self.board = ArmedBoard(host, Board().identity, bench, DriveForce, WRITTEN)
        self.board.newest = TICK - 1
        far.answer = self._answer

    def _answer(self, message: Message) -> list[Message]:
        match message:
            case Arm():
                return [self.to_arm]
            case Safe():
                return self.to_safe
            case RegisterRead(number):
                return [RegisterValue(number, self.reads[number])]
        return []

    @property
    def arms(self) -> int:
        """ARM frames that the board got."""
        return self.far.count(Arm)

    def attend(self, *said: Message, silent_s: float = 0.0):
        """The last row came `silent_s` ago."""
        return self.board.attend(said, time.monotonic_ns() - round(1e9 * silent_s))

    def ends(self, *said: Message, silent_s: float = 0.0) -> str:
        """The line with which the run ends; the board was not armed again."""
        before = self.arms
        with pytest.raises(ProtocolError) as ended:
            self.attend(*said, silent_s=silent_s)
        assert self.arms == before
        assert "\n" not in str(ended.value)
        return str(ended.value)

    def late(self) -> None:
        """This host was silent for as long as the watchdog: it accounts for WATCHDOG."""
        self.board.account.silent(WATCHDOG_NS)

    def lossy(self) -> None:
        """A frame of the board was lost: that accounts for either."""
        self.far.say(rows((0, 0)))
        self.far.lose(1)
        self.far.say(rows((0, 0)))
        arrived(self.host, 2)


@pytest.fixture
def armed() -> Iterator[Armed]:
    with connected() as ends:
        found = Armed(*ends)
        found.board.arm()
        yield found


def stopped(reason: int, state: int = State.SAFE) -> Status:
    return status(state, reason, tick=TICK)


TRIPPED = stopped(SafeReason.WATCHDOG)

# --------------------------------------------------------------------------------------------------- ARM and the end


def test_arm_is_taken_and_safe_is_confirmed(armed: Armed) -> None:
    armed.to_safe = [stopped(SafeReason.HOST_REQUEST)._replace(late=3, tick=TICK + 1)]
    assert (armed.board.safety.armed, armed.board.safety.taken, armed.board.safety.confirmed) == (True, True, None)
    counters = armed.board.to_safe(SafeReason.HOST_REQUEST)
    assert counters["late"] == 3
    safety = armed.board.safety
    assert (safety.confirmed, safety.confirmed_tick, safety.latched, safety.stops) == (True, TICK + 1, "", [])


def test_nothing_is_said_to_a_board_that_was_never_told_arm() -> None:
    with connected() as ends:
        armed = Armed(*ends)
        assert (armed.board.safety.taken, armed.board.safety.rearmed) == (False, 0)
        assert armed.board.to_safe(SafeReason.HOST_REQUEST) == {}
        assert armed.far.count(Safe) == 0
        assert armed.board.safety.confirmed is None


@pytest.mark.parametrize("answer", ["refused", "nothing"])
def test_safe_is_said_after_an_arm_that_failed(answer: str) -> None:
    """Rule 4: on every way out after the first byte of ARM."""
    with connected() as ends:
        armed = Armed(*ends)
        if answer == "refused":
            armed.to_arm = Nack(type_of(Arm), 0, NackReason.LATCHED)
        else:
            armed.far.answer = lambda message: armed.to_safe if isinstance(message, Safe) else []
        with pytest.raises(ProtocolError if answer == "refused" else LinkError) as failed:
            armed.board.arm()
        assert ("protection" in str(failed.value)) == (answer == "refused")
        assert (armed.board.safety.armed, armed.board.safety.taken) == (True, False)
        armed.to_safe = [stopped(SafeReason.HOST_REQUEST)]
        armed.board.to_safe(SafeReason.HOST_REQUEST)
        assert armed.far.count(Safe) == 1
        assert armed.board.safety.confirmed is True


def test_a_stop_that_is_not_answered_is_not_confirmed(armed: Armed) -> None:
    armed.to_safe = []
    assert armed.board.to_safe(SafeReason.HOST_REQUEST) == {}
    assert armed.board.safety.confirmed is False
    assert "cut the supply" in armed.board.safety.alarm


def test_a_fault_that_trips_while_it_is_told_to_stop_has_latched(armed: Armed) -> None:
    armed.to_safe = [stopped(SafeReason.FAULT)]
    armed.board.to_safe(SafeReason.HOST_REQUEST)
    safety = armed.board.safety
    assert (safety.confirmed, safety.latched) == (True, "FAULT")
    assert [(stop.reason, stop.by, stop.tick) for stop in safety.stops] == [("FAULT", "board", TICK)]


def test_the_second_answer_to_a_hello_from_before_arm_ends_nothing() -> None:
    with connected() as ends:
        armed = Armed(*ends)
        armed.far.say(Board().identity)
        armed.host.keep(arrived(armed.host, 1))
        armed.board.arm()
        assert armed.attend(*armed.board.heard()) is None


@pytest.mark.parametrize("timeout_s", [0.1, 1.0, 60.0])
def test_it_is_looked_after_often_enough_to_see_a_silence(timeout_s: float) -> None:
    """Which counts after half of [link] timeout_s; and a recorder that died is told within a second (rule 9)."""
    with connected() as (host, _):
        bench = gyro.unhurried_bench(1.0, "paced", link={"timeout_s": timeout_s, "watchdog_s": 0.5})
        board = ArmedBoard(host, Board().identity, bench, DriveForce, WRITTEN)
        assert board.slice_s == pytest.approx(min(0.25 * timeout_s, 0.25))


@pytest.mark.parametrize(("loop", "block"), [({}, 1), ({"mode": "gain", "block": 20, "estimate_every": 20}, 20)])
def test_what_is_known_of_the_board_is_told_on(
    monkeypatch: pytest.MonkeyPatch, loop: dict[str, Any], block: int
) -> None:
    """Watchdog, block, rate and latency to what accounts for stops; rate, block, patience and newest row to SAFE."""
    told: list[Any] = []

    def safe(*given: Any, **named: Any) -> Stopped:
        told.append((given, named))
        return Stopped(None, False, "no answer")

    monkeypatch.setattr("hil.running.safety.armed.Account", lambda *given: told.append(given))
    monkeypatch.setattr("hil.running.safety.armed.bring_to_safe", safe)
    link = {"timeout_s": TIMEOUT_S, "watchdog_s": 0.7}
    bench = gyro.unhurried_bench(1.0, "paced", link=link, **({"loop": loop} if loop else {}))
    host = Endpoint(Deaf())
    board = ArmedBoard(host, Board().identity._replace(latency_ticks=3, tick_rate_Hz=500.0), bench, DriveForce, WRITTEN)
    assert told == [(host, WATCHDOG, block, 500.0, 3)]
    board.safety.armed, board.newest = True, 77
    assert board.to_safe(SafeReason.INTERRUPTED) == {}
    known = {"rate_Hz": 500.0, "block": block, "newest": 77, "answered": board.answered}
    assert told[1] == ((host, SafeReason.INTERRUPTED, TIMEOUT_S), known)
    assert (board.safety.confirmed, board.safety.words) == (False, "no answer")


class Deaf(Link):
    """Nobody is there."""

    name = "deaf"

    def fileno(self) -> int:
        return 0


@pytest.mark.parametrize(("clock", "share"), [("paced", 0.5), ("lockstep", 1.0)])
def test_how_long_an_answer_to_safe_is_waited_for(monkeypatch: pytest.MonkeyPatch, clock: str, share: float) -> None:
    """Half of [link] timeout_s has passed in silence then; in lockstep all of it has, and begins anew."""
    waited: list[tuple[int, float]] = []

    def make_safe(_: Endpoint, reason: int, patience_s: float) -> Status:
        waited.append((reason, patience_s))
        raise LinkError("silent")

    monkeypatch.setattr("hil.wire.client.make_safe", make_safe)
    bench = gyro.unhurried_bench(1.0, clock, link={"timeout_s": TIMEOUT_S, "watchdog_s": 0.5})
    host = Endpoint(Deaf())
    board = ArmedBoard(host, Board().identity, bench, DriveForce, WRITTEN)
    now_ns = time.monotonic_ns()
    host.received_ns, board._asked_ns = now_ns, now_ns - round(0.5e9 * TIMEOUT_S)  # it has answered since
    for said, silent_s in (((Nack(type_of(DriveForce), 1, NackReason.BAD_STATE),), 0.0), ((), 1.01 * TIMEOUT_S)):
        with pytest.raises(ProtocolError, match=f"deaf: the board fell silent for {TIMEOUT_S:g} s"):
            board.attend(said, now_ns - round(1e9 * silent_s))
    assert waited == [(SafeReason.LINK_LOST, TIMEOUT_S), (SafeReason.LINK_LOST, share * TIMEOUT_S)]


def test_the_boards_own_counts_are_told(armed: Armed) -> None:
    counts = {"late": 1, "held": 2, "bad_frames": 3, "lost_seq": 4, "saturated": 5, "watchdog_trips": 6, "dropped": 7}
    armed.to_safe = [stopped(SafeReason.HOST_REQUEST)._replace(**counts)]
    assert armed.board.to_safe(SafeReason.HOST_REQUEST) == counts


# ---------------------------------------------------------------------------------------------------- armed again


def test_a_board_that_streams_is_left_alone(armed: Armed) -> None:
    running = status(State.RUNNING, SafeReason.NONE, tick=TICK + 7)
    assert armed.board.running is None
    assert armed.attend(running) is None
    assert armed.board.running == TICK + 7
    assert armed.attend() is None
    assert armed.attend(status(State.RUNNING, SafeReason.FAULT)) is None  # of another state it is not looked at
    assert (armed.arms, armed.far.count(Safe)) == (1, 0)


def test_a_watchdog_that_this_host_accounts_for_is_armed_again(armed: Armed) -> None:
    armed.late()
    armed.to_arm = status(State.ARMED, SafeReason.NONE, tick=TICK + 9)
    pause = armed.attend(TRIPPED)
    assert pause == (TICK, TICK + 9)
    assert armed.arms == 2
    safety = armed.board.safety
    assert (safety.rearmed, safety.latched) == (1, "")
    (stop,) = safety.stops
    assert (stop.reason, stop.by, stop.tick, stop.armed_again) == ("WATCHDOG", "board", TICK, True)
    assert stop.account.startswith("this host sent nothing for 0.5 s")


def test_one_that_it_does_not_account_for_ends_the_run(armed: Armed) -> None:
    assert "its watchdog tripped, yet this host was never late" in armed.ends(TRIPPED)
    safety = armed.board.safety
    assert (safety.rearmed, safety.latched, safety.stops[0].armed_again) == (0, "WATCHDOG", False)


@pytest.mark.parametrize(("without", "starved"), [(WATCHDOG // 2 - 1, False), (WATCHDOG // 2, True), (None, True)])
def test_a_watchdog_that_trips_for_want_of_samples_is_known_by_the_ticks(
    armed: Armed, without: int | None, starved: bool
) -> None:
    """Of the board, whose watchdog counts them, whatever time this host saw pass."""
    armed.board.newest = None if without is None else TICK - without
    words = armed.ends(TRIPPED)
    assert ("sends no acceptable sample" in words) == starved
    assert ("never late" in words) == (not starved)


@pytest.mark.parametrize(
    ("trouble", "words", "cure"),
    [
        ("restarted", "the board restarted: SESSION reads 0", "check the board's supply"),
        ("mute", "sends no acceptable sample (nothing was lost on the way)", "check the board's SENSE"),
        (
            "counter",
            "sends no acceptable sample (3 frames repeated a sequence number)",
            "check that the board's sequence counter goes to 65535",
        ),
        ("unexplained", "this host was never late", "check WATCHDOG_TICKS and the board's receiver"),
        ("again", "after it was armed again", "measure the way to the board: hil doctor --link "),
    ],
)
def test_the_end_carries_its_cure(armed: Armed, trouble: str, words: str, cure: str) -> None:
    if trouble == "restarted":
        armed.reads[SPEC.registers["SESSION"].id] = 0
    armed.board.newest = None if trouble in ("mute", "counter") else TICK - 1
    armed.host.rx.repeated += 3 if trouble == "counter" else 0
    if trouble == "again":
        armed.board.safety.rearmed = 3
        armed.late()
    with pytest.raises(ProtocolError) as ended:
        armed.attend(TRIPPED)
    assert words in str(ended.value)
    assert ended.value.cure.startswith(cure)
    assert str(ended.value).endswith(f"; {ended.value.cure}")


def test_what_accounted_for_one_stop_does_not_for_the_next(armed: Armed) -> None:
    armed.late()
    assert armed.attend(TRIPPED) is not None
    assert "never late" in armed.ends(TRIPPED)


def test_what_the_board_missed_before_arming_accounts_for_nothing() -> None:
    """Its counts are since its start; the host's since ARM (rule 6), the first as any later."""
    with connected() as ends:
        armed = Armed(*ends)
        armed.lossy()
        armed.to_arm = status(State.ARMED, SafeReason.NONE, tick=TICK, lost_seq=7)
        armed.board.arm()
        assert "no frame was lost" in armed.ends(TRIPPED._replace(lost_seq=7))
    with connected() as ends:
        armed = Armed(*ends)
        armed.board.arm()
        armed.to_arm = status(State.ARMED, SafeReason.NONE, tick=TICK, lost_seq=7)
        assert armed.attend(TRIPPED._replace(lost_seq=7)) is not None
        assert "no frame was lost" in armed.ends(TRIPPED._replace(lost_seq=7))


def test_it_is_armed_again_so_many_times_at_most(armed: Armed) -> None:
    for _ in range(REARM):
        armed.late()
        assert armed.attend(TRIPPED) is not None
    armed.late()
    words = armed.ends(TRIPPED)
    assert f"armed again {REARM} times, [limits] rearm is {REARM}" in words
    assert armed.arms == 1 + REARM
    assert armed.board.safety.rearmed == REARM
    assert armed.board.safety.latched == "WATCHDOG"


def test_with_a_limit_of_zero_never() -> None:
    with connected() as ends:
        armed = Armed(*ends, rearm=0)
        armed.board.arm()
        armed.late()
        assert "[limits] rearm is 0" in armed.ends(TRIPPED)


@pytest.mark.parametrize("reason", [*LATCHING, SafeReason.NONE, 99])
def test_any_other_reason_ends_the_run_and_is_named(armed: Armed, reason: int) -> None:
    armed.late()
    armed.lossy()
    words = armed.ends(stopped(reason))
    name = reason.name if isinstance(reason, SafeReason) else f"reason {reason}"
    assert name in words
    assert f"at tick {TICK} (1.200 s)" in words
    other = reason in LATCHING and reason != SafeReason.FAULT
    assert ("another node" in words) == other  # this host has not sent it
    assert ("its own protection" in words) == (reason == SafeReason.FAULT)
    assert armed.board.safety.latched.startswith(name)
    assert armed.board.safety.stops[0].by == ("another node" if other else "board")


def test_a_link_lost_that_the_board_says_by_itself_accounts_for_nothing(armed: Armed) -> None:
    armed.late()
    armed.lossy()
    assert "other host" in armed.ends(stopped(SafeReason.LINK_LOST))


@pytest.mark.parametrize("name", list(WRITTEN))
def test_a_register_that_reads_otherwise_means_that_it_restarted(armed: Armed, name: str) -> None:
    armed.late()
    armed.reads[SPEC.registers[name].id] += 1.0
    words = armed.ends(TRIPPED)
    assert "the board restarted" in words
    assert name in words


@pytest.mark.parametrize("state", [State.BOOT, State.IDLE])
def test_a_board_that_is_neither_safe_nor_streaming_restarted(armed: Armed, state: State) -> None:
    armed.late()
    assert f"restarted: it is in {state.name}" in armed.ends(stopped(SafeReason.WATCHDOG, state))


def test_an_arm_that_is_refused_then_ends_the_run(armed: Armed) -> None:
    armed.late()
    armed.to_arm = Nack(type_of(Arm), armed.host.tx.seq + len(WRITTEN), NackReason.LATCHED)
    with pytest.raises(ProtocolError, match="refused ARM"):
        armed.attend(TRIPPED)
    safety = armed.board.safety
    assert (safety.rearmed, safety.latched, safety.stops[0].armed_again) == (0, "WATCHDOG", False)


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (Board().identity, "see that no other host greets the board"),
        (status(99), "state 99, which is not listed"),
    ],
)
def test_what_no_board_says_ends_the_run(armed: Armed, said: Message, words: str) -> None:
    assert words in armed.ends(said)


# -------------------------------------------------------------------------------------------- what it says in between


def test_a_drive_that_is_refused_for_its_state_asks_why(armed: Armed) -> None:
    armed.to_safe = [stopped(SafeReason.FAULT)]
    assert "FAULT" in armed.ends(Nack(type_of(DriveForce), 1, NackReason.BAD_STATE))
    assert [message for message in armed.far.heard if isinstance(message, Safe)] == [Safe(SafeReason.LINK_LOST)]


@pytest.mark.parametrize(
    "said",
    [
        (Nack(type_of(RegisterWrite), 1, NackReason.BAD_STATE),),
        (Nack(type_of(DriveForce), 1, NackReason.OUT_OF_RANGE),),
        (Nack(type_of(DriveForce), 1, NackReason.BAD_STATE), status(State.RUNNING, SafeReason.NONE)),
        (TRIPPED, status(State.ARMED, SafeReason.NONE)),
    ],
)
def test_what_is_no_stop_is_not_taken_for_one(armed: Armed, said: tuple[Message, ...]) -> None:
    assert armed.attend(*said) is None
    assert armed.far.count(Safe) == 0


def test_a_stop_that_is_named_needs_no_asking(armed: Armed) -> None:
    assert "FAULT" in armed.ends(stopped(SafeReason.FAULT), Nack(type_of(DriveForce), 1, NackReason.BAD_STATE))
    assert armed.far.count(Safe) == 0


def test_samples_stay_for_the_loop_when_the_rest_is_heard(armed: Armed) -> None:
    armed.far.say(TRIPPED, rows((3, 4)), status(State.RUNNING, SafeReason.NONE))
    armed.host.keep(arrived(armed.host, 3))
    said = armed.board.heard()
    assert [message for message in said if isinstance(message, Status)] == [
        TRIPPED, status(State.RUNNING, SafeReason.NONE)
    ]  # fmt: skip
    assert [row[3:5] for row in armed.host.receive_rows(0.0)] == [(3, 4)]


def test_a_refusal_from_before_it_was_armed_again_is_no_second_stop(armed: Armed) -> None:
    armed.late()
    armed.far.say(Nack(type_of(DriveForce), 1, NackReason.BAD_STATE), rows((3, 4)))
    armed.host.keep(arrived(armed.host, 2))
    assert armed.attend(TRIPPED) is not None
    assert armed.attend(*armed.board.heard()) is None
    assert armed.far.count(Safe) == 0


# ------------------------------------------------------------------------------------------------------------ silence


def test_half_of_the_patience_without_a_row_is_silence(armed: Armed) -> None:
    assert armed.attend(silent_s=0.3 * TIMEOUT_S) is None
    assert armed.far.count(Safe) == 0
    words = armed.ends(silent_s=0.5 * TIMEOUT_S)
    assert "sends no acceptable sample (nothing was lost on the way)" in words
    assert [message for message in armed.far.heard if isinstance(message, Safe)] == [Safe(SafeReason.LINK_LOST)]
    (stop,) = armed.board.safety.stops
    assert (stop.reason, stop.by) == ("LINK_LOST", "host")


def test_lost_frames_account_for_it_and_being_late_does_not(armed: Armed) -> None:
    armed.lossy()
    assert armed.attend(silent_s=0.5 * TIMEOUT_S) is not None
    assert armed.board.safety.rearmed == 1
    armed.late()
    assert "nothing was lost on the way" in armed.ends(silent_s=0.5 * TIMEOUT_S)
    assert armed.board.safety.latched == "LINK_LOST"


def test_what_the_board_says_when_it_is_asked_counts(armed: Armed) -> None:
    armed.lossy()
    armed.to_safe = [stopped(SafeReason.FAULT)]
    assert "FAULT, its own protection tripped" in armed.ends(silent_s=0.5 * TIMEOUT_S)


def test_one_that_had_tripped_is_the_boards_own_stop(armed: Armed) -> None:
    armed.late()
    armed.to_safe = [TRIPPED]
    assert armed.attend(silent_s=0.5 * TIMEOUT_S) is not None
    (stop,) = armed.board.safety.stops
    assert (stop.reason, stop.by) == ("WATCHDOG", "board")
    # And a LINK_LOST of its own, later, is not taken for the answer to what the host asked then.
    armed.lossy()
    assert "other host" in armed.ends(stopped(SafeReason.LINK_LOST))


def test_drives_that_are_all_refused_are_named(armed: Armed) -> None:
    refusals = [Nack(type_of(DriveForce), k, NackReason.OUT_OF_RANGE) for k in range(7)]
    assert armed.attend(*refusals) is None
    assert "it refused 7 drives, OUT_OF_RANGE" in armed.ends(silent_s=0.5 * TIMEOUT_S)


def test_refusals_from_before_it_was_armed_again_are_forgotten(armed: Armed) -> None:
    assert armed.attend(Nack(type_of(DriveForce), 1, NackReason.OUT_OF_RANGE)) is None
    armed.late()
    assert armed.attend(TRIPPED) is not None
    assert "nothing was lost on the way" in armed.ends(silent_s=0.5 * TIMEOUT_S)


def test_one_that_does_not_answer_fell_silent(armed: Armed) -> None:
    armed.to_safe = []
    assert f"the board fell silent for {TIMEOUT_S:g} s" in armed.ends(silent_s=0.5 * TIMEOUT_S)
    assert armed.board.safety.rearmed == 0


# ----------------------------------------------------------------------------------------------------------- lockstep


@pytest.fixture
def patient() -> Iterator[Armed]:
    with connected() as ends:
        found = Armed(*ends, "lockstep", standstill_s=30.0)
        found.board.arm()
        yield found


def test_in_lockstep_a_board_that_says_nothing_is_waited_for(patient: Armed) -> None:
    waited: list[float] = []
    patient.board.waiting = waited.append
    patient.far.answer = lambda _: []
    assert patient.attend(silent_s=0.9 * TIMEOUT_S) is None
    assert patient.far.count(RegisterRead) == 0
    for silent_s in (1.1 * TIMEOUT_S, 29.0, 29.0):
        assert patient.attend(silent_s=silent_s) is None
    assert waited == [pytest.approx(1.1 * TIMEOUT_S, abs=0.1)]  # now and then, not each time
    time.sleep(1.1 * TIMEOUT_S)
    assert patient.attend(silent_s=29.0) is None
    assert waited[1:] == [pytest.approx(29.0, abs=0.1)]
    said = patient.ends(silent_s=31.0)
    assert "said nothing for 31 s ([limits] standstill_s = 30); check the board's supply and the cable" in said
    assert patient.far.count(Safe) == 0


def test_one_that_answers_and_sends_no_row_is_silent(patient: Armed) -> None:
    silent_ns = time.monotonic_ns() - round(1e9 * 1.1 * TIMEOUT_S)
    assert patient.board.attend([], silent_ns) is None
    arrived(patient.host, 1)  # the register it was asked for
    with pytest.raises(ProtocolError, match="it answers, but sends no acceptable sample"):
        patient.board.attend([], silent_ns)
    assert patient.arms == 1


def test_an_answer_from_before_the_last_row_is_none(patient: Armed) -> None:
    assert patient.attend(silent_s=1.1 * TIMEOUT_S) is None
    arrived(patient.host, 1)
    time.sleep(0.05)
    newest_ns = time.monotonic_ns()  # a row came after that
    time.sleep(1.1 * TIMEOUT_S)
    assert patient.board.attend([], newest_ns) is None
    assert patient.far.count(Safe) == 0
