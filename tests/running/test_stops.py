"""docs/safety.md, "The host" and "Verdict": what a run does with boards that misbehave, each over a pty.

Each of these was seen to end with verdict good, a traceback, or not at all.
"""

import time
from pathlib import Path
from typing import Any, cast

import pytest

from hil.bench import Bench
from hil.errors import InputError
from hil.progress import Progress
from hil.records.result import Result
from hil.records.runfolder import RunFolder
from hil.running.process import supervision
from hil.running.request import RunRequest
from hil.running.run import run
from hil.wire.codec import type_of
from hil.wire.errors import ProtocolError, WireError
from hil.wire.messages import DriveForce, Message, Nack, NackReason, RegisterRead, SafeReason, SenseFlags, State
from hil.wire.spec import SPEC
from hil.wire.stream import Received
from tests.running import gyro, misbehaving
from tests.running.misbehaving import AT, RATE_HZ, Board, served

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_report")]


def bench(duration_s: float = 2.5, clock: str = "paced", **changes: dict[str, Any]) -> Bench:
    given = {"link": {"timeout_s": 1.0, "watchdog_s": 0.5}} | changes
    return gyro.unhurried_bench(duration_s, clock, **given)


class Told:
    """What whoever watches was told, with the time."""

    def __init__(self) -> None:
        self.reports: list[tuple[float, Progress]] = []

    def __call__(self, progress: Progress) -> None:
        self.reports.append((time.monotonic(), progress))

    @property
    def alarms(self) -> list[str]:
        return [report.alarm for _, report in self.reports if report.alarm]


def go(board: Board, declared: Bench, out: Path, told: Told | None = None) -> Result:
    """A run that leaves a record, with the verdict that it got."""
    done = run(RunRequest(declared, board.url), out, progress=told or Told())
    assert done.folder is not None
    result = RunFolder(done.folder).result
    assert result is not None
    return result


def ended(result: Result) -> str:
    """The one reason of a run that was ended for the board's safety: first, and nowhere else in other words."""
    safety = result.parts["safety"]
    assert safety.outcome == "failed", result.parts
    assert safety.next
    assert result.verdict == "interrupted"
    assert "\n" not in result.reasons[0]
    return result.reasons[0]


def test_a_board_that_behaves_passes(tmp_path: Path) -> None:
    """Or nothing here would tell anything."""
    with served(Board()) as board:
        result = go(board, bench(4.0, "lockstep"), tmp_path)
    assert (result.verdict, result.reasons) == ("good", ())
    assert result.parts["safety"].outcome == "good"
    assert (board.arms, board.safes, board.state) == (1, 1, State.SAFE)
    assert board.driven


@pytest.mark.beyond(1)
@pytest.mark.parametrize("why", [SafeReason.FAULT, SafeReason.HOST_REQUEST, SafeReason.RESIDUAL])
def test_a_stop_that_latches_ends_the_run(tmp_path: Path, why: SafeReason) -> None:
    """FAULT is the board's own, the others must come from another node: this host has not sent them."""
    with served(misbehaving.StopsItself(why)) as board:
        result = go(board, bench(60.0), tmp_path)
    reason = ended(result)
    assert why.name in reason
    assert ("its own protection" if why is SafeReason.FAULT else "another node") in reason
    assert board.arms == 1
    assert abs(result.samples - AT) < 0.5 * RATE_HZ
    assert board.driven[-1][0] <= board.safe_heard_s  # type: ignore[operator]


def test_a_stop_is_heeded_though_samples_go_on(tmp_path: Path) -> None:
    with served(misbehaving.StopsItselfAndStreams()) as board:
        result = go(board, bench(60.0), tmp_path)
    assert "FAULT" in ended(result)
    assert board.state is State.SAFE
    assert board.driven[-1][0] < board.safe_heard_s + 2.0 / RATE_HZ  # type: ignore[operator]


def test_a_board_deaf_to_safe_is_unsafe(tmp_path: Path) -> None:
    told = Told()
    with served(misbehaving.Deaf()) as board:
        result = go(board, bench(1.5, link={"timeout_s": 1.0, "watchdog_s": 20.0}), tmp_path, told)
    assert board.safe_heard_s is not None
    assert board.driven[-1][0] > board.safe_heard_s + 0.9  # until the host had gone
    unsafe(result, told)
    assert "did not answer SAFE, sent 8 times" in result.reasons[0]
    assert "SENSE still shows a drive" in result.reasons[0]
    assert board.safes == 8


def test_a_board_that_stops_silently_is_unsafe(tmp_path: Path) -> None:
    """What came before SAFE says nothing of what the board does since."""
    told = Told()
    with served(misbehaving.Obeys()) as board:
        result = go(board, bench(1.5, link={"timeout_s": 1.0}), tmp_path, told)
    unsafe(result, told)
    assert "did not answer SAFE" in result.reasons[0]
    assert "still shows a drive" not in result.reasons[0]


def unsafe(result: Result, told: Told) -> None:
    """The loudest line: at once, first, and with what to do."""
    assert result.verdict == "unsafe"
    assert result.parts["safety"].outcome == "unsafe"
    assert result.parts["safety"].next is not None
    assert "cut the supply" in result.parts["safety"].next
    assert "cut the supply" in result.reasons[0]
    (alarm,) = told.alarms
    assert "cut the supply" in alarm
    stages = [report.stage for _, report in told.reports]
    assert stages.index("stop") < stages.index("report")


def test_a_board_that_says_safe_and_drives_is_unsafe(tmp_path: Path) -> None:
    told = Told()
    with served(misbehaving.Liar()) as board:
        result = go(board, bench(1.5), tmp_path, told)
    unsafe(result, told)
    assert "STATUS says SAFE, yet SENSE of tick" in result.reasons[0]


@pytest.mark.long
def test_a_board_that_streams_in_safe_is_confirmed_and_told(tmp_path: Path) -> None:
    with served(misbehaving.Talkative()) as board:
        result = go(board, bench(1.5), tmp_path)
    assert result.parts["safety"].outcome == "good"
    assert "the board goes on streaming in SAFE" in result.remarks
    assert result.parts["safety"].reason == "SAFE was confirmed, yet the board goes on streaming in SAFE"
    assert "firmware" in (result.parts["safety"].next or "")


def test_safe_is_sent_until_it_is_answered(tmp_path: Path) -> None:
    with served(misbehaving.Hesitant()) as board:
        result = go(board, bench(1.5), tmp_path)
    assert result.parts["safety"].outcome == "good"
    assert board.safes == 3


def test_safe_though_arm_was_not_answered(tmp_path: Path) -> None:
    with served(misbehaving.Speechless()) as board:
        with pytest.raises(WireError, match="no answer to ARM within 1 s"):
            run(RunRequest(bench(), board.url), tmp_path, progress=Told())
        assert board.state is State.SAFE
        assert board.reason is SafeReason.HOST_REQUEST
    assert not list(tmp_path.iterdir())


def test_safe_after_arm_was_not_answered_may_be_unconfirmed(tmp_path: Path) -> None:
    """Then there is a result although nothing was recorded."""

    class Dumb(misbehaving.Speechless, misbehaving.Deaf):
        pass

    told = Told()
    with served(Dumb()) as board:
        result = go(board, bench(), tmp_path, told)
    unsafe(result, told)


@pytest.mark.beyond(1)
@pytest.mark.parametrize(("reason", "words"), [(8, "LATCHED"), (NackReason.BAD_STATE, "not greeted")])
def test_a_refusal_to_be_armed_is_one_line(tmp_path: Path, reason: int, words: str) -> None:
    with served(misbehaving.Refuses(reason)) as board, pytest.raises(ProtocolError, match="refused ARM") as caught:
        run(RunRequest(bench(), board.url), tmp_path, progress=Told())
    assert reason == 8 or words in str(caught.value)
    assert board.arms == 1
    assert board.safes == 1


@pytest.mark.beyond(1)
@pytest.mark.parametrize(("n", "width"), [(0, 2), (65535, 2), (1, 7)])
@pytest.mark.parametrize("at", [0, AT])
def test_rows_that_cannot_be_accepted_are_silence(tmp_path: Path, n: int, width: int, at: int) -> None:
    begin = time.monotonic()
    with served(misbehaving.Gibberish(n, width, at)) as board:
        reason = ended(go(board, bench(60.0), tmp_path))
        assert board.state is State.SAFE
    assert "sends no acceptable sample" in reason
    assert "contradicted themselves" in reason
    assert board.arms == 1
    assert time.monotonic() - begin < 20.0


@pytest.mark.beyond(1)
@pytest.mark.parametrize("clock", ["paced", "lockstep"])
def test_a_board_that_answers_and_streams_nothing(tmp_path: Path, clock: str) -> None:
    with served(misbehaving.Still(AT)) as board:
        reason = ended(go(board, bench(60.0, clock), tmp_path))
    assert "sends no acceptable sample" in reason or "restarted" in reason
    assert board.arms <= 2  # its watchdog may have tripped for the silence, once


@pytest.mark.parametrize("watchdog_s", [0.2, 0.5])
def test_a_watchdog_that_trips_for_want_of_samples_is_no_fault_of_it(tmp_path: Path, watchdog_s: float) -> None:
    with served(misbehaving.Still(AT)) as board:
        reason = ended(go(board, bench(60.0, link={"timeout_s": 4.0, "watchdog_s": watchdog_s}), tmp_path))
    assert "the board went to SAFE: it answers, but sends no acceptable sample (nothing was lost on the way)" in reason
    assert board.arms == 1


def test_nor_is_it_where_the_board_runs_through_it_at_once(tmp_path: Path) -> None:
    """By its ticks a board that catches up with the time is without a drive for 0.5 s; by this host's clock 0.1 s."""
    with served(misbehaving.StillAndLate(AT)) as board:
        reason = ended(go(board, bench(60.0), tmp_path))
    assert "the board went to SAFE: it answers, but sends no acceptable sample (nothing was lost on the way)" in reason
    assert board.arms == 1


def test_a_register_that_reads_otherwise_is_refused(tmp_path: Path) -> None:
    for honest in (True, False):
        for dry in (True, False):
            board = misbehaving.Stubborn("WATCHDOG_TICKS", 16.0, honest=honest)
            with served(board), pytest.raises(ProtocolError, match="WATCHDOG_TICKS reads 16 after 200 was written"):
                run(RunRequest(bench(), board.url, dry_run=dry), tmp_path, progress=Told())
            assert board.arms == 0
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("dry", [True, False])
def test_an_identity_that_no_board_can_have_is_refused(tmp_path: Path, dry: bool) -> None:
    with (
        served(Board(), drive_scale_mps2=1e300) as board,
        pytest.raises(InputError, match=r"IDENTITY\.drive_scale_mps2 is .*; correct the firmware$") as caught,
    ):
        run(RunRequest(bench(), board.url, dry_run=dry), tmp_path, progress=Told())
    assert "\n" not in str(caught.value)
    assert board.arms == 0


def test_a_session_that_reads_one_more_is_refused(tmp_path: Path) -> None:
    """A register gives back the very double that was written."""
    said = r"SESSION reads \d+ after \d+ was"
    with served(misbehaving.Miscounts()) as board, pytest.raises(ProtocolError, match=said):
        run(RunRequest(bench(), board.url, dry_run=True), tmp_path, progress=Told())
    assert board.arms == 0


def test_a_clock_that_stands_still_is_refused(tmp_path: Path) -> None:
    with served(misbehaving.ClockStands()) as board, pytest.raises(ProtocolError, match="clock went on by 0 s in"):
        run(RunRequest(bench(), board.url, dry_run=True), tmp_path, progress=Told())
    assert board.arms == 0


@pytest.mark.realtime  # it is compared with the clock on the wall
@pytest.mark.parametrize("factor", [0.8, 1.25, 2.0])
def test_a_clock_that_does_not_keep_time_is_refused(tmp_path: Path, factor: float) -> None:
    with served(misbehaving.ClockRuns(factor)) as board, pytest.raises(ProtocolError, match="clock went on by"):
        run(RunRequest(bench(), board.url, dry_run=True), tmp_path, progress=Told())
    assert board.arms == 0


@pytest.mark.beyond(1)
@pytest.mark.parametrize(("axis", "code", "words"), [("x", 0, "stands still"), ("y", 2**15 - 1, "stands still")])
def test_a_channel_that_stands_still_is_refused_before_the_first_drive(
    tmp_path: Path, axis: str, code: int, words: str
) -> None:
    with served(misbehaving.Stuck(axis, code)) as board:
        result = go(board, bench(60.0), tmp_path)
    assert board.driven == []
    assert result.reasons[0].startswith(f"nothing was driven: sense {axis} {words}")
    assert result.verdict == "interrupted"
    assert board.state is State.SAFE


@pytest.mark.beyond(2)
@pytest.mark.parametrize("lax", [False, True])
@pytest.mark.parametrize("streams", [False, True])
@pytest.mark.parametrize("clock", ["paced", "lockstep"])
def test_a_board_that_restarted_is_never_armed_again(tmp_path: Path, lax: bool, streams: bool, clock: str) -> None:
    with served(misbehaving.Restarts(lax=lax, streams=streams)) as board:
        reason = ended(go(board, bench(60.0, clock), tmp_path))
    assert "restart" in reason
    assert board.arms == 1


def test_a_watchdog_that_nobody_accounts_for_ends_the_run(tmp_path: Path) -> None:
    with served(misbehaving.CriesWatchdog()) as board:
        reason = ended(go(board, bench(60.0), tmp_path))
    assert "its watchdog tripped, yet this host was never late" in reason
    assert board.arms == 1


@pytest.mark.beyond(1)
@pytest.mark.parametrize("clock", ["paced", "lockstep"])
def test_ticks_that_cannot_have_passed_end_the_run(tmp_path: Path, clock: str) -> None:
    with served(misbehaving.Jumps()) as board:
        result = go(board, bench(60.0, clock), tmp_path)
    assert "tick jumped" in result.reasons[0]
    assert board.state is State.SAFE


@pytest.mark.long
def test_ticks_leap_in_lockstep_no_further_than_frames_were_lost(tmp_path: Path) -> None:
    """A second of them, and not one frame is missing."""
    with served(misbehaving.Jumps(400)) as board:
        reason = ended(go(board, bench(60.0, "lockstep"), tmp_path))
    assert "tick jumped" in reason
    assert board.state is State.SAFE


def test_drives_that_are_all_refused_are_named(tmp_path: Path) -> None:
    class Full(Board):
        def on_drive(self, drive: DriveForce) -> list[Message]:
            return [Nack(type_of(DriveForce), self._seq, NackReason.OUT_OF_RANGE)]

        def answer(self, item: Received) -> list[Message]:
            answers = super().answer(item)
            self.waits = any(isinstance(message, Nack) for message in answers)
            return answers

        def row(self) -> bytes:  # in lockstep a refused drive lets no tick pass
            return b"" if self.lockstep and self.waits else super().row()

    with served(Full()) as board:
        reason = ended(go(board, bench(60.0, "lockstep"), tmp_path))
    assert "drives, OUT_OF_RANGE" in reason
    assert board.state is State.SAFE


def test_a_record_of_one_sample_is_told(tmp_path: Path) -> None:
    class Stutters(Board):
        def say_row(self, tick: int, vx: int, vy: int, ux: int, uy: int) -> bytes:
            return super().say_row(tick, vx, vy, ux, uy) + super().say_row(tick, vx, vy, ux, uy)

    with served(Stutters()) as board:
        result = go(board, bench(60.0, "lockstep"), tmp_path)
    assert "tick went back" in ended(result)
    assert "too few" in result.parts["model"].reason


@pytest.mark.long
def test_a_run_is_bounded_in_wall_time(tmp_path: Path) -> None:
    """The board's ticks come at half the rate it says."""
    board = Board()
    declared = bench(4.0, device={"sample_rate_Hz": 800.0}, limits={"overtime": 0.25, "late_fraction": 1.0})
    with served(board, tick_rate_Hz=800.0):
        result = go(board, declared, tmp_path)
    assert any("the run of 4 s was not over after 6 s" in reason for reason in result.reasons), result.reasons
    assert board.state is State.SAFE


# ------------------------------------------------------------------- wire.md, "What a host does with what it hears"


@pytest.mark.beyond(1)
@pytest.mark.parametrize(
    ("status", "words"),
    [
        ((99, 77), "STATUS gives state 99, which is not listed"),
        ((State.SAFE, 99), "gives reason 99, which is not listed"),
        ((State.SAFE, SafeReason.NONE), "gives NONE"),
    ],
)
def test_a_status_that_cannot_be_ends_the_run(tmp_path: Path, status: tuple[int, int], words: str) -> None:
    with served(misbehaving.SaysStatus(*status)) as board:
        reason = ended(go(board, bench(60.0), tmp_path))
    assert words in reason
    assert "restarted" not in reason
    assert (board.arms, board.state) == (1, State.SAFE)


@pytest.mark.beyond(1)
@pytest.mark.parametrize("reason", [SafeReason.NONE, SafeReason.LINK_LOST, SafeReason.WATCHDOG, 99])
def test_a_reason_that_does_not_latch_confirms_no_stop(tmp_path: Path, reason: int) -> None:
    told = Told()
    with served(misbehaving.Unmoved(reason)) as board:
        unsafe(go(board, bench(1.5), tmp_path, told), told)


def test_an_identity_that_nobody_asked_for_ends_the_run(tmp_path: Path) -> None:
    with served(misbehaving.Introduces(twice=False)) as board:
        reason = ended(go(board, bench(60.0), tmp_path))
    assert "IDENTITY" in reason
    assert "other host" in reason
    assert (board.arms, board.state) == (1, State.SAFE)


@pytest.mark.long
def test_a_hello_that_was_repeated_has_two_answers(tmp_path: Path) -> None:
    with served(misbehaving.Introduces(twice=True)) as board:
        result = go(board, bench(4.0, "lockstep"), tmp_path)
    assert result.verdict == "good"


@pytest.mark.beyond(2)
@pytest.mark.parametrize("clock", ["paced", "lockstep"])
@pytest.mark.parametrize(
    ("shown", "flags"),
    [
        (lambda ux, uy: (0, 0), 0),
        (lambda ux, uy: (-ux, uy), 0),
        (lambda ux, uy: (ux, uy + 1), 0),
        (lambda ux, uy: (2 * ux, 2 * uy), SenseFlags.SATURATED),
        (lambda ux, uy: (ux + 5, uy), SenseFlags.HELD),
    ],
)
def test_an_echo_that_disagrees_ends_the_run(tmp_path: Path, clock: str, shown: Any, flags: int) -> None:
    with served(misbehaving.Echoes(shown, flags)) as board:
        reason = ended(go(board, bench(60.0, clock), tmp_path))
    assert "shows the drive codes" in reason
    assert (board.arms, board.state) == (1, State.SAFE)


@pytest.mark.long
def test_a_board_that_limits_further_and_says_so_is_believed(tmp_path: Path) -> None:
    with served(misbehaving.Echoes(lambda ux, uy: (ux // 2 if ux > 0 else ux, 0), SenseFlags.SATURATED)) as board:
        result = go(board, bench(2.5, "lockstep"), tmp_path)
    assert result.parts["safety"].outcome == "good", result.reasons


@pytest.mark.beyond(1)
@pytest.mark.parametrize("answer", [(State.IDLE, 0), (State.SAFE, SafeReason.HOST_REQUEST), (99, 98)])
def test_an_arm_answered_by_another_state_is_refused(tmp_path: Path, answer: tuple[int, int]) -> None:
    with served(misbehaving.Answers(*answer)) as board, pytest.raises(ProtocolError, match="answered ARM") as caught:
        run(RunRequest(bench(), board.url), tmp_path, progress=Told())
    assert (State(answer[0]).name if answer[0] != 99 else "state 99") in str(caught.value)
    assert (board.arms, board.state) == (1, State.SAFE)


def test_a_hello_that_is_refused_is_not_called_unanswered(tmp_path: Path) -> None:
    with served(misbehaving.RefusesHello()) as board, pytest.raises(ProtocolError, match="refused HELLO: BAD_STATE"):
        run(RunRequest(bench(), board.url, dry_run=True), tmp_path, progress=Told())


@pytest.mark.beyond(1)
@pytest.mark.parametrize("clock", ["paced", "lockstep"])
def test_a_board_that_takes_arm_and_streams_nothing_has_a_verdict(tmp_path: Path, clock: str) -> None:
    with served(misbehaving.Still(0)) as board:
        result = go(board, bench(60.0, clock), tmp_path)
    assert "sends no acceptable sample" in ended(result)
    assert (result.samples, board.state) == (0, State.SAFE)


# ----------------------------------------------------------------- asked once more after SAFE, and what ends no run


@pytest.mark.beyond(2)
@pytest.mark.parametrize("clock", ["paced", "lockstep"])
@pytest.mark.parametrize("kind", [misbehaving.StaysRunning, misbehaving.WakesUp])
def test_a_board_that_says_safe_and_is_not_is_unsafe(tmp_path: Path, clock: str, kind: type[Board]) -> None:
    """In lockstep it streams nothing until it is driven: what it says by STATUS is all there is."""
    told = Told()
    with served(kind()) as board:
        result = go(board, bench(2.5, clock, link={"timeout_s": 1.0, "watchdog_s": 20.0}), tmp_path, told)
    unsafe(result, told)
    assert "STATUS says SAFE, yet" in result.reasons[0]
    assert board.safes >= 1


@pytest.mark.beyond(2)
@pytest.mark.parametrize("clock", ["paced", "lockstep"])
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (misbehaving.Swallows, "it does not refuse a drive in SAFE"),
        (misbehaving.RefusesOtherwise, "it refuses a drive in SAFE by OUT_OF_RANGE, not BAD_STATE"),
        (misbehaving.Mute, "it does not refuse a drive in SAFE"),
        (lambda: misbehaving.Forgets("SESSION"), "the board restarted: SESSION reads 0"),
        (lambda: misbehaving.Forgets("DRIVE_LIMIT", 8388607.0), "DRIVE_LIMIT reads 8388607"),
        (
            lambda: misbehaving.Complains(type_of(DriveForce), NackReason.OUT_OF_RANGE, sent=True),
            "as no board does that keeps to the page (DRIVE_FORCE, OUT_OF_RANGE)",
        ),
        (
            lambda: misbehaving.Complains(type_of(DriveForce), NackReason.OUT_OF_RANGE, sent=False),
            "200 frames that this host had not sent",
        ),
        (lambda: misbehaving.Complains(0x11, NackReason.BAD_STATE, sent=True), "200 frames that this host had not"),
    ],
)
def test_what_no_board_does_fails_a_run_that_it_does_not_end(tmp_path: Path, clock: str, kind: Any, words: str) -> None:
    with served(kind()) as board:
        result = go(board, bench(2.5, clock), tmp_path)
    safety = result.parts["safety"]
    assert (result.verdict, safety.outcome) == ("failed", "failed"), result.parts
    assert words in safety.reason
    assert "firmware" in (safety.next or "")
    assert board.state is State.SAFE


@pytest.mark.beyond(2)
@pytest.mark.parametrize(
    "at",
    [
        lambda message: isinstance(message, DriveForce),
        lambda message: message == RegisterRead(SPEC.registers["DRIVE_LIMIT"].id),
    ],
)
def test_a_board_that_waits_for_its_processor_in_safe_is_not_accused(tmp_path: Path, at: Any) -> None:
    with served(misbehaving.Starved(1.2, at)) as board:
        result = go(board, bench(2.5, link={"timeout_s": 0.6}), tmp_path)
    assert result.parts["safety"].outcome == "good", result.parts["safety"]


@pytest.mark.parametrize(("driven", "confirmed"), [(0xBAD, True), (0xBEEF, False)])
def test_after_a_dead_loop_the_board_that_was_driven_answers(driven: int, confirmed: bool) -> None:
    """Another may have the link's name by then; it is told to be SAFE, and speaks for nobody else."""

    class NotOurs:
        def ends_within(self, _: float) -> bool:
            return False

    with served(Board()) as board:
        told = supervision._confirm(board.url, bench(2.5, link={"timeout_s": 1.0}), cast(Any, NotOurs()), driven)
    assert told["confirmed"] is confirmed
    assert ("another board answers at" in told["words"]) is not confirmed
    assert ("0000000000000bad, 000000000000beef was driven" in told["words"]) is not confirmed


@pytest.mark.beyond(1)
@pytest.mark.parametrize(("ticks", "numbers"), [(20_000, False), (20_000, True), (1, False)])
def test_in_lockstep_no_tick_is_left_out(tmp_path: Path, ticks: int, numbers: bool) -> None:
    """A board goes on by one for each drive; a line lets one pass for each frame that it lost, and no more of them than
    its watchdog waits for a drive.
    """
    with served(misbehaving.Skips(ticks, numbers=numbers)) as board:
        reason = ended(go(board, bench(60.0, "lockstep", limits={"lost_fraction": 1.0}), tmp_path))
    assert f"tick jumped from {AT} to {AT + ticks + 1}" in reason
    assert board.state is State.SAFE


@pytest.mark.beyond(1)
def test_in_lockstep_a_tick_is_missing_with_the_frame_that_a_line_lost(tmp_path: Path) -> None:
    with served(misbehaving.Skips(1, numbers=True)) as board:
        result = go(board, bench(2.5, "lockstep", limits={"lost_fraction": 1.0}), tmp_path)
    assert result.parts["safety"].outcome == "good", result.parts
    assert any(remark.startswith("1 sample ") and "lost on the way" in remark for remark in result.remarks)


def test_on_wall_time_a_tick_is_missing_with_its_frame_only(tmp_path: Path) -> None:
    lax = {"lost_fraction": 1.0}
    with served(misbehaving.Skips(300)) as board:
        reason = ended(go(board, bench(60.0, limits=lax), tmp_path / "many"))
    assert "of which no frame is missing for 300" in reason
    with served(misbehaving.Skips(3)) as board:
        result = go(board, bench(2.5, limits=lax), tmp_path / "few")
    assert result.parts["safety"].outcome == "failed"
    assert "its ticks left out 3 for which no frame is missing" in result.parts["safety"].reason
    with served(misbehaving.Skips(3, numbers=True)) as board:
        result = go(board, bench(2.5, limits=lax), tmp_path / "lost")
    assert result.parts["safety"].outcome == "good", result.parts
