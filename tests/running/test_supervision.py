"""The process that follows the loop's: its end, also where what sees to the board fails."""

import subprocess
import sys

import pytest

from hil.bench import load_bench
from hil.bench.examples import find
from hil.running.process import supervision
from hil.running.process.worker import Order
from hil.running.request import RunRequest

ARMED = """
import sys
sys.stdin.readline()
print('{"armed": true, "board": 5}', flush=True)
"""


def test_what_fails_for_a_driven_board_is_the_error_that_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop's process is gone by then, and was waited for."""

    def failing(*_: object) -> None:
        raise RuntimeError("the port is gone")

    monkeypatch.setattr(supervision, "_confirm", failing)
    bench = load_bench(find("bench", "s-slow")).with_(loop={"clock": "lockstep"})
    with subprocess.Popen([sys.executable, "-c", ARMED], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as worker:
        order = Order(RunRequest(bench, "serial:/dev/null"), "runs")
        with pytest.raises(RuntimeError, match="the port is gone"):
            supervision.supervise(worker, order, lambda _: None, None)  # type: ignore[arg-type]
