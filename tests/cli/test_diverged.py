"""An observer that diverged, through every verb: an exit code, no traceback, no word of NumPy's, JSON that is JSON."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Hil
from tests.cli.diverged import KINDS, write_diverged_run
from tests.forked import hil_says
from tests.running.gyro import bench, bench_file

pytestmark = pytest.mark.slow


def no_fault(err: str) -> None:
    """Nothing of what is said to people is one."""
    for word in ("Traceback", "Warning", "fault of hil"):
        assert word not in err, err


def process(place: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """`hil` as a process in which a warning is an error, as it is in this one."""
    done = hil_says(*arguments, cwd=place, env=os.environ | {"PYTHONWARNINGS": "error"})
    no_fault(done.stderr)
    return done


def strict(text: str) -> Any:
    """JSON without the numbers that it has not."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def place(kind: str, tmp_path: Path) -> Path:
    write_diverged_run(tmp_path / "run", kind)
    return tmp_path


@pytest.mark.long
def test_score(hil: Hil, place: Path, kind: str) -> None:
    for more in ([], ["--json"]):
        code, out, err = hil("score", "run", "--truth", "run-truth.arrow", *more)
        assert code in (0, 1), err
        no_fault(err)
    result = strict(out)
    assert strict((place / "run" / "result.json").read_text(encoding="utf-8")) == result
    assert result["parameters"] == {} or kind == "huge"
    page = (place / "run" / "report.html").read_text(encoding="utf-8")
    assert page.count("<figure ") >= 5
    assert "nan" not in page.partition("</style>")[2].lower().replace("nanos", "")


@pytest.mark.parametrize("more", [["check", "run"], ["export", "run", "-o", "out.csv"]], ids=lambda more: more[0])
@pytest.mark.usefixtures("place")
def test_check_and_export(hil: Hil, more: list[str]) -> None:
    code, out, err = hil(*more, "--json")
    assert code == 0, err
    no_fault(err)
    strict(out)


DIVERGES = {
    "observer": {
        "memory_s": 0.006,
        "process_noise": {"force_mps2_per_rtHz": 1e-30, "rate_rad_s_per_rts": 0.0},
        "initial_sd": {"rate_rad_s": 1000.0, "stiffness": 1.0, "damping": 1e6},
    },
    "device": {"sense": {"noise_V": 1e-10}},
    "limits": {"residual_safe": 1e4},
}
"""A memory of one cycle, a millionth of the noise, next to nothing known: 100,000 times the noise off."""


@pytest.mark.long
def test_run_replay_and_trace(tmp_path: Path) -> None:
    bench_file(tmp_path / "sick.bench.toml", bench(2.0, **DIVERGES))
    link = ["--link", "inproc:s-slow", "--out", "runs", "--json"]
    done = process(tmp_path, "run", "sick.bench.toml", *link)
    assert done.returncode == 1, done.stderr
    result = strict(done.stdout)
    assert result["verdict"] == "interrupted"
    assert "residual_safe" in result["reasons"][0]
    (folder,) = (tmp_path / "runs").iterdir()
    assert (folder / "report.html").exists()
    done = process(tmp_path, "replay", str(folder), "--bench", "sick.bench.toml", "--json", "--out", "again")
    assert done.returncode in (0, 1), done.stderr  # what there is of it ends before scoring starts
    strict(done.stdout)
    done = process(tmp_path, "trace", str(folder), "--bench", "sick.bench.toml", "--json", "--out", "traced")
    assert done.returncode in (0, 1, 2), done.stderr
    told = strict(done.stdout)
    assert (told["exit_code"] == 2 and told["remedy"]) if done.returncode == 2 else told["verdict"]
    assert (tmp_path / "traced").exists() == (done.returncode != 2)
