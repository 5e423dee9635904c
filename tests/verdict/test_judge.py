"""How the parts come together: worst first, an unsafe run above all, what comes next.

The rules are those of docs/reference/run-folder.md (Verdict) and docs/safety.md (Verdict).
"""

from pathlib import Path
from typing import Any

import pytest

from hil import verdict
from hil.bench import examples
from hil.records.result import Angle, Answers, Part, Result
from hil.records.runfolder import RunFolder
from hil.verdict import Judgement
from tests.running import gyro

GOOD = {
    "safety": Part(outcome="good", reason="confirmed"),
    "machine": Part(outcome="good", reason="all in time"),
    "model": Part(outcome="complete", reason="nothing is missing"),
    "angle": Part(outcome="good", reason="± 1.9 mrad"),
}
BAD = {
    "safety": Part(outcome="failed", reason="FAULT latched", next="look at the board"),
    "machine": Part(outcome="failed", reason="12 % late", next="hil doctor"),
    "model": Part(outcome="lacks", reason="drive gain", next="hil trace runs/a"),
    "angle": Part(outcome="failed", reason="± 310 mrad"),
}
UNSAFE = Part(outcome="unsafe", reason="SAFE was not confirmed: cut the supply", next="cut the supply")


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """`judged(stopped="…", complete=False, model=Part(…))`: four parts as given, good where not."""

    def judge(
        stopped: str = "",
        complete: bool = True,
        angled: bool = False,
        cure: str = "",
        innovation_rms: float | None = None,
        **parts: Part,
    ) -> Judgement:
        for name, part in (GOOD | parts).items():
            monkeypatch.setattr(verdict, f"judge_{name}", lambda *_, part=part, **__: part)
        counted = Answers(
            ticks=9, in_time=9, late=0, unanswered=0, lost_to_board=0, lost_to_host=0, stopped=0, slow=0
        )  # fmt: skip
        result = Result(
            run="r", seconds=1.0, samples=9, answers=counted, complete=complete, innovation_rms=innovation_rms
        )
        if angled:
            result = result.model_copy(update={"angle": Angle(kind="pattern", rad=1.0)})
        outcome = {"stopped": stopped, "cure": cure, "counters": {}, "refused": ["memory is not locked"]}
        return verdict.judge(RunFolder(tmp_path / "a run"), result, gyro.bench(), outcome)

    return judge


def test_four_good_parts_are_a_good_run(judged: Any) -> None:
    found = judged()
    assert (found.verdict, found.reasons, found.remarks) == ("good", (), ("memory is not locked",))
    assert list(found.parts) == ["safety", "machine", "model", "angle"]
    assert found.next.startswith("hil export '")
    assert found.next.endswith("a run' --what estimates")


@pytest.mark.parametrize("name", list(BAD))
def test_one_part_fails_the_run_and_leaves_the_others_what_they_are(judged: Any, name: str) -> None:
    found = judged(**{name: BAD[name]})
    assert (found.verdict, found.reasons) == ("failed", (BAD[name].reason,))
    assert {part: found.parts[part] for part in GOOD if part != name} == {
        part: GOOD[part] for part in GOOD if part != name
    }


def test_the_worst_part_says_what_is_next(judged: Any) -> None:
    assert judged(**BAD).next == "look at the board"
    assert judged(machine=BAD["machine"], model=BAD["model"]).next == "hil doctor"
    assert judged(model=BAD["model"], angle=BAD["angle"]).next == "hil trace runs/a"
    hint = Part(outcome="good", reason="confirmed", next="nothing")
    assert judged(safety=hint, model=BAD["model"]).next == "hil trace runs/a"  # a good part asks for nothing


def test_the_first_reason_that_has_a_cure_says_what_is_next(judged: Any) -> None:
    assert judged(stopped="sense x stands still; check it", cure="check it", model=BAD["model"]).next == "check it"
    assert judged(stopped="stopped on request", model=BAD["model"]).next == "hil trace runs/a"
    assert judged(stopped="x", cure="check it", safety=BAD["safety"]).next == "look at the board"


def test_the_next_command_fits_a_run_where_no_part_asks_for_anything(judged: Any) -> None:
    assert judged(angled=True).next.endswith("a run' --what angle")
    assert judged(stopped="stopped on request").next.startswith("hil check '")
    lacks, invalid = Part(outcome="lacks", reason="innovation 9 ×"), BAD["angle"]
    assert judged(model=lacks, innovation_rms=1e-3).next.startswith("hil trace '")
    assert judged(angle=invalid, angled=True, innovation_rms=1e-4).next.startswith("hil compare '")
    diverged = judged(model=lacks, angle=invalid)  # of which a trace would say nothing
    assert diverged.next.startswith("xdg-open '")
    assert diverged.next.endswith("a run/report.html'")


def test_unsafe_stands_above_all(judged: Any) -> None:
    found = judged(stopped="the board hung up", complete=False, safety=UNSAFE, machine=BAD["machine"])
    assert (found.verdict, found.next) == ("unsafe", "cut the supply")


@pytest.mark.parametrize(("stopped", "complete"), [("stopped on request", True), ("", False)])
def test_a_run_that_ended_early_is_interrupted(judged: Any, stopped: str, complete: bool) -> None:
    found = judged(stopped=stopped, complete=complete, model=BAD["model"])
    assert found.verdict == "interrupted"
    assert found.reasons == (*((stopped,) if stopped else ()), "drive gain")


def test_an_angle_that_failed_with_the_machine_says_what_to_mend_first(judged: Any) -> None:
    assert "fix the late answers first" in judged(machine=BAD["machine"], angle=BAD["angle"]).parts["angle"].reason
    assert judged(angle=BAD["angle"]).parts["angle"] == BAD["angle"]
    assert judged(machine=BAD["machine"], model=BAD["model"]).parts["model"].reason.startswith("drive gain; the mach")
    assert judged(safety=BAD["safety"], model=BAD["model"]).parts["model"] == BAD["model"]


@pytest.mark.parametrize("part", ["safety", "model"])
def test_why_it_ended_is_said_once_and_after_what_concerns_safety(judged: Any, part: str) -> None:
    said = {part: BAD[part], "angle": BAD["angle"]}
    assert judged(stopped=BAD[part].reason, **said).reasons == (BAD[part].reason, "± 310 mrad")
    other = judged(stopped="stopped on request", **said).reasons
    first = (BAD[part].reason, "stopped on request") if part == "safety" else ("stopped on request", BAD[part].reason)
    assert other == (*first, "± 310 mrad")


@pytest.fixture
def again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """`again(result, angle)`: the result judged once more, its angle then as given."""
    (tmp_path / "bench.toml").write_text(examples.find("bench", "s-slow").read_text(encoding="utf-8"), encoding="utf-8")

    def judge(result: Result, angle: Part) -> Result:
        monkeypatch.setattr(verdict, "judge_angle", lambda *_: angle)
        return verdict.judge_again(RunFolder(tmp_path), result)

    return judge


def result_of(verdict_word: Any, reasons: tuple[str, ...] = (), **parts: Part) -> Result:
    given: Any = {"verdict": verdict_word, "reasons": reasons, "parts": GOOD | parts}
    return Result(run="r", seconds=1.0, samples=9, complete=True, **given)


def test_a_wrong_truth_fails_a_good_run_and_the_right_one_clears_it(again: Any) -> None:
    failed = again(result_of("good"), BAD["angle"])
    assert (failed.verdict, failed.reasons, failed.parts["angle"]) == ("failed", ("± 310 mrad",), BAD["angle"])
    cleared = again(failed, GOOD["angle"])
    assert (cleared.verdict, cleared.reasons, cleared.parts) == ("good", (), GOOD)
    assert cleared.next.startswith("hil export ")


def test_judged_once_more_the_other_parts_stay_what_they_are(again: Any) -> None:
    machine = BAD["machine"]
    found = again(result_of("failed", (machine.reason,), machine=machine), BAD["angle"])
    assert found.reasons == (machine.reason, found.parts["angle"].reason)
    assert found.parts["angle"].reason.startswith("± 310 mrad; fix the late answers first")
    assert again(found, BAD["angle"]).reasons == found.reasons
    unsafe = again(result_of("unsafe", (UNSAFE.reason,), safety=UNSAFE), BAD["angle"])
    assert (unsafe.verdict, unsafe.reasons[0]) == ("unsafe", UNSAFE.reason)
    assert again(result_of("interrupted", ("stopped",)), GOOD["angle"]).verdict == "interrupted"


def test_judged_once_more_the_cure_of_an_earlier_reason_stays_next(again: Any) -> None:
    stopped = result_of("interrupted", ("stopped",)).model_copy(update={"next": "hil identify LINK"})
    wrong = BAD["angle"].model_copy(update={"next": "calibrate it"})
    assert again(stopped, wrong).next == "hil identify LINK"
    assert again(result_of("good"), wrong).next == "calibrate it"


def test_a_run_that_was_not_judged_is_not_judged_again(again: Any) -> None:
    bare = Result(run="r", seconds=1.0, samples=9, complete=True)
    assert again(bare, BAD["angle"]) == bare
