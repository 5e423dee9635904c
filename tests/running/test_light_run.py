"""A process of a run loads what it uses: no compiler, no SymPy, no SciPy to drive a board; a replay no more. What takes
long to load is loaded by a process of its own, beside what else has to be done.
"""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from hil.bench import load_bench
from hil.bench.examples import find
from hil.records.runfolder import RunFolder
from hil.report.artist import artist_process
from hil.report.page import render
from hil.running.process.start import started_ahead, worker_process
from hil.running.process.worker import Order
from hil.running.request import RunRequest

HEAVY = ("numba", "llvmlite", "sympy", "scipy", "pandas", "matplotlib", "filterpy")
DRIVEN = """
import json, sys
from hil.running.process.worker import Order, work
work(Order.read(), lambda **said: None, own_process=False)
print(*[name for name in json.loads(sys.argv[1]) if name in sys.modules])
"""
CONCLUDED = """
import sys
from hil.cli import execute
code = execute(sys.argv[1:])
heavy = ("numba", "llvmlite", "sympy", "pandas", "scipy.signal", "scipy.stats", "matplotlib")
print(code, *[name for name in heavy if name in sys.modules])
"""


def said(program: str, *arguments: str, folder: Path, given: bytes = b"") -> str:
    """The last line that a program of its own prints."""
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        capture_output=True,
        input=given,
        check=False,
        cwd=folder,
        env=os.environ | {"GYROHIL_WORKERS": "2"},
    )
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout.decode().rstrip("\n").split("\n")[-1]


def children() -> set[int]:
    """Process ids of those that this thread has started."""
    return set(map(int, Path(f"/proc/{os.getpid()}/task/{threading.get_native_id()}/children").read_text().split()))


def test_the_process_of_the_loop_loads_no_more_than_numpy(tmp_path: Path) -> None:
    bench = load_bench(find("bench", "s-slow")).with_(loop={"clock": "lockstep", "duration_s": 0.05, "settle_s": 0.0})
    order = Order(RunRequest(bench, f"inproc:{find('scenario', 's-slow')}"), str(tmp_path))
    assert said(DRIVEN, json.dumps(HEAVY), folder=tmp_path, given=order.line) == ""


def test_a_run_and_a_replay_load_no_compiler_and_no_sympy(tmp_path: Path) -> None:
    bench = tmp_path / "short.bench.toml"
    text = find("bench", "s-slow").read_text()
    replaced = text.replace('clock = "paced"', 'clock = "lockstep"').replace("duration_s = 30.0", "duration_s = 9.0")
    assert replaced != text
    bench.write_text(replaced)
    link = f"inproc:{find('scenario', 's-slow')}"
    assert said(CONCLUDED, "run", str(bench), "--link", link, "--name", "one", folder=tmp_path) == "0"
    record = next((tmp_path / "runs").iterdir())
    assert said(CONCLUDED, "replay", str(record), "--bench", str(bench), "--name", "two", folder=tmp_path) == "0"
    folder = RunFolder(record)
    assert (record / "report.html").read_text() == render(folder)  # the figures are the same, whoever draws them


def test_the_first_run_takes_the_loop_process_that_was_started_ahead() -> None:
    with started_ahead():
        with worker_process() as first, worker_process() as second:
            assert first.pid != second.pid
            begun = children()
            assert {first.pid, second.pid} <= begun
        assert first.returncode is not None
    with started_ahead():
        unused = children() - begun
        assert len(unused) == 1
    assert not children() & unused


def test_an_artist_that_dies_leaves_the_figures_to_who_asks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GYROHIL_WORKERS", "2")
    with artist_process() as artist:
        (tmp_path / "capture.arrow").write_bytes(b"no record")
        artist.draw(tmp_path)
        assert artist.drawn() is None
    monkeypatch.setenv("GYROHIL_WORKERS", "1")
    with artist_process() as artist:
        artist.draw(tmp_path)
        assert artist.drawn() is None
