"""Ctrl-C and SIGTERM once the board is SAFE: the end comes at once, result.json is there, and one line says what is."""

import json
import signal
import time
from pathlib import Path

import pytest

from hil.records.result import load_result
from tests.cli.conftest import Start, finished
from tests.cli.test_processes import wait_for

pytestmark = [pytest.mark.slow, pytest.mark.realtime]  # whole processes, by the clock

ENDS_S = 2.0


@pytest.mark.beyond(1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize(("stage", "after_s"), [("scan", 0.0), ("report", 0.0), ("report", 0.5), ("report", 1.5)])
def test_a_run_ends_at_once_and_says_what_is_there(
    start: Start, short_bench: str, tmp_path: Path, stage: str, after_s: float, number: signal.Signals
) -> None:
    host = start("run", short_bench, "--link", "inproc:s-slow", "--note", "after the shock")
    wait_for(host, stage)
    time.sleep(after_s)
    if host.poll() is not None:
        pytest.skip("the report was drawn before the signal came")
    begin = time.monotonic()
    host.send_signal(number)
    code, out, err = finished(host)
    took_s = time.monotonic() - begin
    (folder,) = (tmp_path / "runs").iterdir()
    result = load_result(folder / "result.json")
    assert (code, out) == (130, ""), err
    assert took_s < ENDS_S
    told = [line for line in err.splitlines() if line not in ("scan", "report")]
    assert len(told) == 2, err
    assert told[0].startswith("SAFE was confirmed at tick ")
    assert f"the record is whole: runs/{folder.name}; " in told[0]
    assert told[1] == "hil: interrupted"
    assert result.complete
    assert result.operator_note == "after the shock"
    assert result.samples == 12000
    assert not (folder / "report.html").exists()
    if result.verdict == "interrupted":
        assert told[0].endswith("its figures and report are not made: `hil replay` gives them")
    else:
        assert result.innovation_rms is not None
        assert told[0].endswith("its figures are in result.json, its report is not drawn")


@pytest.mark.beyond(1)
@pytest.mark.parametrize("after_s", [0.5, 2.0])
def test_a_score_says_whether_its_figures_are_there(
    start: Start, recorded: Path, tmp_path: Path, after_s: float
) -> None:
    before = (recorded / "result.json").read_text(encoding="utf-8")
    host = start("score", str(recorded), "--truth", "truth.arrow")
    time.sleep(after_s)
    if host.poll() is not None:
        pytest.skip("it was done before the signal came")
    begin = time.monotonic()
    host.send_signal(signal.SIGINT)
    code, _, err = finished(host)
    assert code == 130, err
    assert time.monotonic() - begin < ENDS_S
    after = (recorded / "result.json").read_text(encoding="utf-8")
    assert "Traceback" not in err
    *rest, last = err.splitlines()
    assert last == "hil: interrupted"
    if not rest:  # before it had begun
        assert after == before
        return
    told = rest[-1]
    scored = json.loads(after)["score"] is not None
    assert scored == (after != before)
    assert told.endswith("the report was not made again" if scored else "nothing of it was changed")
