"""The model's part of the verdict: the closing scan's answer, and the command that comes next."""

import shlex
from pathlib import Path

from hil.records.result import Result, Scan
from hil.records.runfolder import RunFolder
from hil.verdict.model import judge_model
from tests.loop import gyro


def result(complete: bool | None, *, ratio: float = 1.0) -> Result:
    """A run whose scan said so."""
    scan = Scan(complete=complete, reason="as the scan says", samples=1000, span_s=1.0, seconds=0.1)
    return Result(
        run="r", seconds=1.0, samples=1000, complete=True, scan=scan, innovation_rms=ratio * 1e-4, noise_floor=1e-4
    )


def test_what_the_scan_lacks_is_held_against_the_model_with_the_trace_that_comes_next(tmp_path: Path) -> None:
    place = tmp_path / "a run"
    place.mkdir()
    part = judge_model(RunFolder(place), result(False), gyro.bench())
    assert part.outcome == "lacks"
    assert part.against
    assert "as the scan says" in part.reason
    assert part.next is not None
    words = shlex.split(part.next)
    assert words == ["hil", "trace", str(place), "--bench", str(place / "bench.toml")]


def test_a_complete_model_says_why(tmp_path: Path) -> None:
    part = judge_model(RunFolder(tmp_path), result(True), gyro.bench())
    assert (part.outcome, part.reason, part.next) == ("complete", "as the scan says", None)


def test_what_could_not_be_scanned_is_unknown_and_not_held_against_the_run(tmp_path: Path) -> None:
    part = judge_model(RunFolder(tmp_path), result(None), gyro.bench())
    assert part.outcome == "unknown"
    assert not part.against
    assert part.reason


def test_an_innovation_above_its_limit_is_held_against_a_complete_model(tmp_path: Path) -> None:
    part = judge_model(RunFolder(tmp_path), result(True, ratio=1.6), gyro.bench())
    assert part.outcome == "lacks"
    assert "1.6" in part.reason
