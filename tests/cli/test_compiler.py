"""NUMBA_DISABLE_JIT in the environment: every verb that computes says so in one line, the others do not mind."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hil.records.check import check
from tests.records.synthetic_run import Options, write_run

COMPUTING = (
    ["run", "s-slow", "--link", "inproc:s-slow", "--clock", "lockstep"],
    ["run", "s-slow"],
    ["emulate", "s-slow"],
    ["demo"],
    ["replay", "run/capture.arrow", "--bench", "s-slow"],
    ["trace", "run/capture.arrow", "--bench", "s-slow"],
)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("interpreted")
    write_run(folder / "run", Options(seconds=1.0))
    return folder


def hil(place: Path, *arguments: str, told: str = "1") -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"NUMBA_DISABLE_JIT": told, "PYTHONWARNINGS": "error"}
    return subprocess.run(
        [sys.executable, "-m", "hil", *arguments], cwd=place, env=environment, capture_output=True, text=True,
        timeout=120, check=False,
    )  # fmt: skip


@pytest.mark.beyond(2)
@pytest.mark.slow
@pytest.mark.parametrize("arguments", COMPUTING, ids=" ".join)
def test_without_its_compiler_a_verb_says_why_and_what_to_do(place: Path, arguments: list[str]) -> None:
    done = hil(place, *arguments)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    (line,) = [line for line in done.stderr.splitlines() if line not in ("demo", "connect")]
    assert line.startswith("hil: NUMBA_DISABLE_JIT=1: ")
    assert "unset NUMBA_DISABLE_JIT" in line
    assert not list(place.glob("runs/*"))


@pytest.mark.slow
def test_what_computes_nothing_does_not_mind(place: Path) -> None:
    done = hil(place, "check", "run")
    assert done.returncode == 0, done.stderr
    assert all(entry.whole for entry in check(place / "run"))


@pytest.mark.slow
def test_zero_says_that_it_may_compile(place: Path) -> None:
    done = hil(place, "run", "no-such-bench", told="0")
    assert done.returncode == 2
    assert "NUMBA" not in done.stderr
