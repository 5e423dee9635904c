"""The machine's part of the verdict: limits, whose doing it was, and the command that comes next.

The rules are those of docs/reference/run-folder.md (What became of each sample; Verdict).
"""

from typing import Any

import pytest

from hil.bench import Bench
from hil.records.result import Answers, Load, Part, Result
from hil.verdict.machine import by_host, judge_machine, mishaps
from tests.running import gyro

REAL, EMULATED = "serial:/dev/ttyACM0", "pty:s slow.toml"
IDLE = {"waited": 0.001, "stolen": 0.0, "pressed": 0.001}


def bench(late: float = 0.05, lost: float = 0.05) -> Bench:
    return gyro.bench(limits={"late_fraction": late, "lost_fraction": lost})


def result(*, link: str = REAL, slow: int = 0, load: dict[str, float] | None = None, **parts: int) -> Result:
    """A run of 1000 ticks, in time but for `parts`."""
    counted = dict.fromkeys(("late", "unanswered", "lost_to_board", "lost_to_host", "stopped"), 0) | parts
    lost = counted["lost_to_host"] + counted["stopped"]
    answers = Answers(ticks=1000, in_time=1000 - sum(counted.values()), slow=slow, **counted)
    return Result(
        run="r",
        link=link,
        seconds=1.0,
        samples=1000 - lost,
        lost=lost,
        late=answers.late,
        answers=answers,
        load=Load(loop=0.3, recorder=0.1, **(IDLE if load is None else load)),
        complete=True,
    )


def judged(run: Result, refused: tuple[str, ...] = (), **limits: float) -> Part:
    return judge_machine(run, bench(**limits), refused, "runs/a/bench.toml")


def test_all_in_time_is_good_and_says_how_much() -> None:
    part = judged(result())
    assert (part.outcome, part.reason, part.next) == ("good", "all of 1000 samples answered in time", None)
    assert judged(result(late=1)).reason == "99.90\u00a0% of 1000 samples answered in time"


@pytest.mark.parametrize("kind", ["late", "unanswered", "lost_to_board"])
def test_each_kind_of_missed_answer_counts_against_late_fraction(kind: str) -> None:
    assert judged(result(**{kind: 50})).outcome == "good"
    part = judged(result(**{kind: 51}))
    assert part.outcome == "failed"
    assert part.reason.startswith("5.10\u00a0% of the samples had no answer in time (51 ")


def test_they_count_together() -> None:
    part = judged(result(late=20, unanswered=20, lost_to_board=20))
    assert part.outcome == "failed"
    assert "(20 answered late, 20 not answered, 20 lost on the way to the board)" in part.reason


@pytest.mark.parametrize("kind", ["lost_to_host", "stopped"])
def test_what_is_not_in_the_record_counts_as_lost_and_not_as_late(kind: str) -> None:
    assert judged(result(**{kind: 50}), late=0.0).outcome == "good"
    part = judged(result(**{kind: 51}), late=0.0)
    assert part.reason.startswith("5.10\u00a0% of the samples lost")
    assert ("51 of them while the board was SAFE" in part.reason) == (kind == "stopped")


def test_no_board_no_judgement() -> None:
    nobody = Result(run="r", seconds=1.0, samples=10, complete=True)
    assert judged(nobody).outcome == "unknown"
    assert mishaps(nobody, {}) == []


def test_nothing_is_named_that_is_not_known() -> None:
    run = result(late=100).model_copy(update={"load": None})
    assert "not known here" in judged(run).reason


@pytest.mark.parametrize(
    ("load", "slow", "mine"),
    [
        (IDLE, 0, False),
        (IDLE, 49, False),
        (IDLE, 50, True),  # half of the answers left later than the board waits
        ({"waited": 0.049, "stolen": 0.0, "pressed": 0.9}, 0, False),
        ({"waited": 0.051, "stolen": 0.0, "pressed": 0.9}, 0, True),  # without a processor for half of what was missed
        ({"waited": 0.0, "stolen": 0.051, "pressed": 0.9}, 0, True),  # what the machine runs on took it
    ],
)
def test_the_hosts_own_stalls_are_told_from_the_links(load: dict[str, float], slow: int, mine: bool) -> None:
    run = result(unanswered=60, late=40, slow=slow, load=load)
    assert by_host(run) is mine
    reason = judged(run).reason
    assert ("this machine was too busy" in reason) is mine
    assert ("the link or the board was slow" in reason) is not mine


def test_an_emulated_board_shares_the_machine() -> None:
    """The loop may have its processor all the time, under real-time scheduling, and the board none."""
    load = {"waited": 0.001, "stolen": 0.0, "pressed": 0.9}
    assert by_host(result(unanswered=100, load=load, link=EMULATED))
    assert not by_host(result(unanswered=100, load=load, link=REAL))


def test_frames_that_were_lost_are_the_links() -> None:
    busy = {"waited": 0.9, "stolen": 0.0, "pressed": 0.9}
    assert "the link loses frames" in judged(result(lost_to_board=100, load=busy)).reason


@pytest.mark.parametrize(
    ("link", "refused", "busy", "command"),
    [
        (REAL, (), False, "hil doctor --link serial:/dev/ttyACM0"),
        (REAL, (), True, "hil doctor"),
        (EMULATED, (), False, "hil doctor --link 'pty:s slow.toml'"),
        (EMULATED, (), True, "hil run runs/a/bench.toml --link 'pty:s slow.toml' --clock lockstep"),
        (EMULATED, ("no real-time scheduling: Operation not permitted",), True, "hil doctor"),
    ],
)
def test_the_next_command(link: str, refused: tuple[str, ...], busy: bool, command: str) -> None:
    load: dict[str, Any] = {"waited": 0.9, "stolen": 0.0, "pressed": 0.9} if busy else IDLE
    assert judged(result(late=100, link=link, load=load), refused).next == command


def test_mishaps_speak_of_the_same_count() -> None:
    run = result(late=3, unanswered=4, lost_to_board=5, lost_to_host=6, stopped=7)
    told = mishaps(run, {"rearmed": 2, "frames_damaged": 1, "board_late": 99, "board_lost_seq": 99})
    assert told[0] == "6 samples (0.60\u00a0%) were lost on the way; the observer predicted over the gaps"
    assert told[1] == "damaged frames were dropped, 1 by the host and 0 by the board"
    assert told[2].endswith("2 times and was armed again; 7 samples were not taken meanwhile")
    assert "99" not in " ".join(told)
    (clipped,) = mishaps(result(), {"clipped": 1})
    assert clipped == "the sense converter was at its end in 1 sample (flag CLIPPED)"


def test_of_one_nothing_is_told_in_the_plural() -> None:
    told = mishaps(result(late=1, lost_to_host=1, stopped=1), {"rearmed": 1})
    assert told[0].startswith("1 sample (0.10\u00a0%) was lost on the way")
    assert told[1] == "the board went to SAFE once and was armed again; 1 sample was not taken meanwhile"


def test_what_was_measured_of_the_processors_is_told() -> None:
    busy = {"waited": 0.04, "stolen": 0.021, "pressed": 0.9}
    words = "(the loop lacked a processor 6.1\u00a0% of the time, CPU fully loaded 90.0\u00a0% of the time)"
    assert f"this machine was too busy {words}" in judged(result(late=100, load=busy)).reason
    slow = {"waited": 0.001, "stolen": 0.0}  # a system that says nothing of its pressure
    assert judged(result(late=100, load=slow)).reason.endswith(
        "the link or the board was slow, or the loop was stopped (the loop lacked a processor 0.1\u00a0% of the time)"
    )
    unknown = judged(result(late=100, slow=100, load={"pressed": 0.9})).reason
    assert unknown.endswith("this machine was too busy (CPU fully loaded 90.0\u00a0% of the time)")
