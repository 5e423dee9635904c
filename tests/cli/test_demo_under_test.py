"""`hil demo`: what its boards are started with, what is done when that was not enough, and its exit code."""

from pathlib import Path
from typing import Any

import pytest

from hil import cli, demo
from hil.bench import examples, load_bench
from hil.records.diagnosis import Coefficient, Effect
from hil.records.result import Answers, Part, Result, load_result, save_result
from hil.records.runfolder import RunFolder
from hil.records.setting import Setting
from hil.report import page
from hil.running import run as loop_run
from hil.running.rehearsal import Started, after_late
from hil.running.request import RunRequest
from tests.cli.diagnoses import explained, save_trace
from tests.running import gyro

LATE = Part(outcome="failed", reason="6.6 % of the samples had no answer in time", next="hil doctor")
PARTS: dict[Any, Part] = {
    "safety": Part(outcome="good", reason="SAFE was confirmed"),
    "machine": Part(outcome="good", reason="all in time"),
    "model": Part(outcome="complete", reason="nothing is missing"),
    "angle": Part(outcome="good", reason="uncertain by 20 mrad (k = 2) at the end"),
}
CHOICE = "measured: the board is started with latency 4 ticks"
HARDENING = Effect(
    name="cubic_stiffness", title="cubic stiffness", equations=(), evidence=1000.0, compensation="by the drive",
    coefficients={"k3x": Coefficient(value=1.0e13, ci95=(0.9e13, 1.1e13), unit="1/(m²·s²)")},
)  # fmt: skip


def answers(late: int) -> Answers:
    return Answers(
        ticks=1000, in_time=1000 - late, late=late, unanswered=0, lost_to_board=0, lost_to_host=0, stopped=0, slow=0
    )  # fmt: skip


def saved(folder: Path, *, error_rad: float, late: int = 0, **parts: Part) -> Path:
    folder.mkdir(parents=True)
    told = PARTS | parts
    verdict = "failed" if any(part.against for part in told.values()) else "good"
    result = Result(
        run=folder.name, seconds=12.0, samples=1000, answers=answers(late), angle_error_rms_rad=error_rad,
        verdict=verdict, parts=told, complete=True, remarks=(CHOICE,),
    )  # fmt: skip
    save_result(folder / "result.json", result)
    return folder


@pytest.fixture
def circle(tmp_path: Path) -> Any:
    """`circle(after={"machine": LATE})`: a whole circle, its runs with other parts or figures than good ones."""

    def make(before: dict[str, Any] | None = None, after: dict[str, Any] | None = None, **said: Any) -> demo.Circle:
        first = saved(tmp_path / "before", **({"error_rad": 0.126, "model": Part(outcome="lacks")} | (before or {})))
        last = saved(tmp_path / "after", **({"error_rad": 0.0012} | (after or {})))
        save_trace(tmp_path / "trace", explained(effects=(HARDENING,)).model_copy(update=said))
        return demo.Circle(first, tmp_path / "trace", last, (CHOICE,))

    return make


def exit_code(monkeypatch: pytest.MonkeyPatch, shown: demo.Circle) -> int:
    monkeypatch.setattr(demo, "demo", lambda *_, **__: shown)
    return cli.execute(["demo"])


def test_late_answers_are_told_and_are_not_under_test(
    circle: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Error 126 → 1.2 mrad with 6.6 % late: each result under test was shown; the verdict of the run stays as it is."""
    late = {"late": 66, "machine": LATE}
    assert exit_code(monkeypatch, circle(before=late, after=late)) == 0
    told = capsys.readouterr().out
    assert f"machine    {CHOICE}" in told
    assert told.count(CHOICE) == 1  # and not once more among the remarks of the run
    assert "shown      angle error 130\u00a0mrad before, 1.2\u00a0mrad after and within its uncertainty" in told
    assert "not shown" not in told
    assert "verdict  failed: machine" in told
    assert "6.6 % of the samples had no answer in time" in told


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"after": {"safety": Part(outcome="unsafe", reason="no")}}, "both boards confirmed SAFE"),
        ({"before": {"safety": Part(outcome="failed", reason="no")}}, "both boards confirmed SAFE"),
        ({"verdict": "partly explained"}, "the trace explains the residual"),
        ({"after": {"error_rad": 0.2}}, "angle error"),
        ({"after": {"angle": Part(outcome="failed", reason="off")}}, "angle error"),
        ({"after": {"model": Part(outcome="lacks", reason="drive gain")}}, "the model is complete"),
    ],
)
def test_each_result_under_test_can_fail(
    circle: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], changed: Any, words: str
) -> None:
    assert exit_code(monkeypatch, circle(**changed)) == 1
    failed = [line for line in capsys.readouterr().out.splitlines() if line.startswith("not shown")]
    assert any(words in line for line in failed)
    assert all(line.startswith("not shown  ") for line in failed)


def test_nothing_found_is_no_demonstration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = saved(tmp_path / "before", error_rad=0.1)
    assert exit_code(monkeypatch, demo.Circle(before, None, None, (), "too little is left")) == 1


def test_a_late_run_is_repeated_once_with_the_next_choice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both runs are kept, and told; the runs that follow have the later choice."""
    asked: list[tuple[str, str]] = []
    drawn: list[str] = []

    def run(request: RunRequest, out: Path, **_: Any) -> Any:
        asked.append((request.bench.loop.clock, request.link.rpartition("?")[2]))
        folder = saved(out / f"{len(asked)}", error_rad=0.1, late=66 if len(asked) == 1 else 10)
        return loop_run.RunResult(folder, {})

    choices = iter([Started(Setting(4, 1, 4000.0), "second choice"), None, None])
    monkeypatch.setattr(loop_run, "run", run)
    monkeypatch.setattr(page, "write_report", lambda folder, _: drawn.append(folder.name))
    monkeypatch.setattr(demo, "measured", lambda *_: Started(Setting(2, 1, 4000.0), "first choice"))
    monkeypatch.setattr(demo, "after_late", lambda *_: next(choices))
    runs = demo._Runs("s-undeclared", tmp_path, tmp_path, lambda _: None)
    folder, truth = runs.run(gyro.bench(12.0, "paced"))
    runs.run(gyro.bench(12.0, "paced"))
    assert asked == [("paced", "latency=2"), ("paced", "latency=4"), ("paced", "latency=4")]
    assert (folder.name, truth.name) == ("2", "truth-2.arrow")
    assert runs.told == ["first choice", "second choice"]
    assert [load_result(tmp_path / f"{n}" / "result.json").remarks[-1] for n in (1, 2)] == runs.told
    assert drawn == ["1"]


def test_a_run_within_its_limit_is_not_repeated(tmp_path: Path) -> None:
    bench = gyro.bench(12.0, "paced", limits={"late_fraction": 0.05})
    started = Started(Setting(2, 1, 4000.0), "first choice")
    assert after_late(RunFolder(saved(tmp_path / "good", error_rad=0.1, late=50)), bench, started) is None
    again = after_late(RunFolder(saved(tmp_path / "late", error_rad=0.1, late=51)), bench, started)
    assert again is not None  # without wall times nothing can be foretold
    assert again.setting is None
    assert "late in spite of latency 2 ticks, so the run was repeated: late" in again.words
    assert again.bench(bench).loop.clock == "lockstep"


def test_block_and_rate_of_a_board_in_gain_mode() -> None:
    started = Started(Setting(0, 341, 50_000.0), "half the rate")
    bench = started.bench(load_bench(examples.find("bench", demo.GAIN_MODE_EXAMPLE)))
    assert (bench.loop.block, bench.device.sample_rate_Hz) == (341, 50_000.0)
    assert started.link("pty:s-modern-5k") == "pty:s-modern-5k?rate=50000"
