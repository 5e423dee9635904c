"""`hil trace` as a process that is interrupted at moments nobody chose: one line, within a second, nothing left."""

import json
import random
import signal
import time
from pathlib import Path

import pytest

from estimator.side_by_side import WORKERS
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import make
from tests.cli.conftest import WAIT_S, Start
from tests.cli.test_processes import children_of, line_of

pytestmark = [pytest.mark.slow, pytest.mark.realtime]  # whole processes, and a clock

PROMISED_S = 1.0
LASTS_S = 4.0
"""A trace of the record takes longer on any machine, however many threads it has."""


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A record with a line, whose frequency is searched for, in a folder with its bench file."""
    return make(Order("single", ("interference",), 0, draw=2), tmp_path_factory.mktemp("record"), 60_000)


@pytest.mark.beyond(1)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("at", range(4))
@pytest.mark.parametrize("workers", [1, 3])
def test_ctrl_c_stops_a_trace_within_a_second(
    start: Start, record: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, at: int, workers: int
) -> None:
    monkeypatch.setenv(WORKERS, str(workers))
    trace = start("trace", str(record / "capture.arrow"), "--bench", str(record / "bench.toml"), "--json")
    while line_of(trace, "stderr") != "effects":
        assert trace.poll() is None
    moment = LASTS_S * (at + random.random()) / 4.0
    time.sleep(moment)
    assert trace.poll() is None
    children = children_of(trace.pid)
    begin = time.monotonic()
    trace.send_signal(number)
    code = trace.wait(WAIT_S)
    took = time.monotonic() - begin
    assert trace.stdout is not None
    assert trace.stderr is not None
    *stages, last = trace.stderr.read().splitlines()
    assert (code, last) == (130, "hil: interrupted"), f"after {moment:.3f} s"
    assert json.loads(trace.stdout.read())["exit_code"] == 130
    assert set(stages) <= {"effects", "checks", "experiments"}
    assert took < PROMISED_S, f"after {moment:.3f} s"
    assert not list(tmp_path.iterdir())
    assert not children
