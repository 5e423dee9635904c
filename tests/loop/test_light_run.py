"""A process of a run loads what it uses: no compiler, no SymPy, no SciPy to drive a board; a replay no more."""

import json
import subprocess
import sys
from pathlib import Path

from hil.bench import load_bench
from hil.bench.examples import find

HEAVY = ("numba", "llvmlite", "sympy", "scipy", "pandas", "matplotlib", "filterpy")
DRIVEN = """
import json, sys
from hil.loop.worker import Order, work
order = json.loads(sys.argv[1])
work(Order(**order), lambda **said: None, own_process=False)
print(*[name for name in json.loads(sys.argv[2]) if name in sys.modules])
"""
CONCLUDED = """
import sys
from hil.cli import execute
code = execute(sys.argv[1:])
heavy = ("numba", "llvmlite", "sympy", "pandas", "scipy.signal", "scipy.stats")
print(code, *[name for name in heavy if name in sys.modules])
"""


def said(program: str, *arguments: str, folder: Path) -> str:
    """The last line that a program of its own prints."""
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False, cwd=folder
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.rstrip("\n").split("\n")[-1]


def test_the_process_of_the_loop_loads_no_more_than_numpy(tmp_path: Path) -> None:
    bench = load_bench(find("bench", "s-slow")).with_(loop={"clock": "lockstep", "duration_s": 0.05, "settle_s": 0.0})
    order = {"bench": bench.model_dump_json(), "link": f"inproc:{find('scenario', 's-slow')}", "folder": str(tmp_path)}
    assert said(DRIVEN, json.dumps(order), json.dumps(HEAVY), folder=tmp_path) == ""


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
