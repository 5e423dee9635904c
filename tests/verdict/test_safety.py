"""The safety part of the verdict, row by row of docs/safety.md (Verdict), and the line that comes before everything."""

from typing import Any

import pytest

from hil.records.result import Part
from hil.running.safety.latching import LATCHING, Safety, Stop, reason_name
from hil.verdict.safety import judge_safety, remarks
from hil.wire.messages import SafeReason

LATCHED = Stop("FAULT", "board", 480)
ACCOUNTED = Stop("WATCHDOG", "board", 77, "this host sent nothing for 0.5 s", armed_again=True)
TROUBLE: dict[str, dict[str, Any]] = {
    "nothing": {},
    "latched": {"latched": "FAULT", "stops": [LATCHED]},
    "broke": {"broke": "the board restarted"},
    "recorder": {"recorder": "No space left on device"},
    "signs": {"signs": "the drive of x acts the wrong way round"},
    "rearmed": {"rearmed": 1, "stops": [ACCOUNTED]},
}


def outcome(stopped: str = "", **known: Any) -> dict[str, Any]:
    """What the loop's process tells of a board that was armed."""
    return {"stopped": stopped, "safety": Safety(**({"armed": True, "taken": True} | known)).told}


def judged(stopped: str = "", **known: Any) -> Part:
    return judge_safety(outcome(stopped, **known))


@pytest.mark.parametrize("told", [{}, {"stopped": "the disk is full"}, outcome(armed=False, confirmed=None)])
def test_where_nothing_was_armed_nothing_is_known(told: dict[str, Any]) -> None:
    part = judge_safety(told)
    assert part.outcome == "unknown"
    assert not part.against


def test_a_confirmed_stop_is_good() -> None:
    part = judged(confirmed=True)
    assert part.outcome == "good"
    assert part.next is None


@pytest.mark.parametrize("trouble", TROUBLE)
def test_a_stop_that_was_not_confirmed_is_unsafe_whatever_else_there_was(trouble: str) -> None:
    part = judged("the board hung up", confirmed=False, words="the board did not answer SAFE", **TROUBLE[trouble])
    assert part.outcome == "unsafe"
    assert part.reason.startswith("SAFE was not confirmed: cut the supply")
    assert "the board did not answer SAFE" in part.reason
    assert part.next is not None
    assert "cut the supply" in part.next


def test_an_unsafe_run_names_what_had_latched_too() -> None:
    part = judged("it was stopped", confirmed=False, words="no answer", **TROUBLE["latched"])
    assert "FAULT at tick 480" in part.reason
    assert "it was stopped" in part.reason
    alone = judged(confirmed=False, words="no answer")
    assert alone.reason.endswith("no answer")
    said_once = judged("no answer", confirmed=False, words="no answer")
    assert said_once.reason.count("no answer") == 1


@pytest.mark.parametrize("trouble", ["latched", "broke", "recorder", "signs"])
@pytest.mark.parametrize("confirmed", [True, None])
def test_what_fails_a_run_whose_stop_was_confirmed(trouble: str, confirmed: bool | None) -> None:
    part = judged("the run ended early", confirmed=confirmed, **TROUBLE[trouble])
    assert part.outcome == "failed"
    assert part.reason
    assert part.next  # what to do


def test_a_reason_that_latched_is_named() -> None:
    assert "FAULT at tick 480" in judged(confirmed=True, **TROUBLE["latched"]).reason
    both = judged("interrupted by the operator", confirmed=True, **TROUBLE["latched"]).reason
    assert both.startswith("interrupted by the operator")
    assert "FAULT at tick 480" in both
    once = judged("the board stopped itself: FAULT", confirmed=True, **TROUBLE["latched"]).reason
    assert once == "the board stopped itself: FAULT"  # in the words of the run's end where it was that


def test_the_hosts_own_stop_is_not_called_the_boards() -> None:
    stop = Stop("LINK_LOST", "host", 480)
    part = judged("it answers, but sends no acceptable sample", confirmed=True, latched="LINK_LOST", stops=[stop])
    assert part.reason == "it answers, but sends no acceptable sample"


def test_the_last_stop_is_the_one_that_latched() -> None:
    part = judged(confirmed=True, latched="FAULT", stops=[ACCOUNTED, LATCHED])
    assert "FAULT at tick 480" in part.reason
    assert "WATCHDOG" not in part.reason


def test_what_to_do_depends_on_what_latched() -> None:
    acts = [judged(confirmed=True, latched=why).next for why in ("FAULT", "WATCHDOG", "HOST_REQUEST")]
    assert "only the board lifts a FAULT" in str(acts[0])
    assert "hil doctor" in str(acts[1])
    assert len(set(acts)) == 3


@pytest.mark.parametrize("trouble", ["latched", "broke"])
def test_what_comes_next_is_the_cure_of_what_ended_the_run(trouble: str) -> None:
    told = outcome("it restarted; check the board's supply", confirmed=True, **TROUBLE[trouble])
    assert judge_safety(told | {"cure": "check the board's supply"}).next == "check the board's supply"


def test_a_recorder_that_died_and_a_wrong_sign_are_told_in_any_case() -> None:
    assert "No space left on device" in judged(confirmed=True, **TROUBLE["recorder"]).reason
    sign = TROUBLE["signs"]["signs"]
    assert judged(confirmed=True, **TROUBLE["signs"]).reason == sign
    assert judged("innovation out of bounds", confirmed=True, **TROUBLE["signs"]).reason == sign
    longer = f"innovation out of bounds: {sign}"
    assert judged(longer, confirmed=True, **TROUBLE["signs"]).reason == longer


def test_an_emulated_board_that_has_ended_is_failed_and_not_unsafe() -> None:
    part = judged(confirmed=None, words="the emulated board has ended, and drives nothing")
    assert part.outcome == "failed"
    assert "drives nothing" in part.reason
    assert judged("the loop's process was killed by SIGKILL", confirmed=None).reason.endswith("SIGKILL")


def test_a_board_that_was_armed_again_is_good_with_a_remark() -> None:
    told = outcome(confirmed=True, rearmed=1, stops=[ACCOUNTED])
    assert judge_safety(told).outcome == "good"
    (line,) = remarks(told)
    assert line.startswith("WATCHDOG at tick 77, accounted for (this host sent nothing for 0.5 s)")


def test_only_stops_that_were_survived_are_remarks() -> None:
    assert remarks({}) == []
    assert remarks(outcome(confirmed=True, stops=[LATCHED])) == []
    streams = "the board goes on streaming in SAFE"
    assert remarks(outcome(confirmed=True, words=streams)) == [streams]
    assert remarks(outcome(confirmed=False, words="the board did not answer SAFE")) == []  # that is the verdict itself


def test_the_alarm_is_for_what_was_not_confirmed_and_nothing_else() -> None:
    safety = Safety(armed=True, confirmed=False, words="the board did not answer SAFE")
    assert safety.alarm.startswith("SAFE was not confirmed: cut the supply")
    assert "the board did not answer SAFE" in safety.alarm
    assert Safety(armed=True, confirmed=True, words="the board goes on streaming in SAFE").alarm == ""
    assert Safety(armed=True, confirmed=None, words="the emulated board has ended").alarm == ""
    assert Safety(confirmed=False).alarm == ""


def test_reasons_go_by_the_names_of_the_page_and_latch_as_it_says() -> None:
    latches = {"HOST_REQUEST": True, "INTERRUPTED": True, "RESIDUAL": True, "FAULT": True}
    latches |= {"NONE": False, "WATCHDOG": False, "LINK_LOST": False}
    assert {reason_name(reason): reason in LATCHING for reason in SafeReason} == latches
    assert reason_name(99) == "reason 99, which is not listed"
