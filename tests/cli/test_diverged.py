"""An observer that diverged, through every verb: an exit code, no traceback, no word of NumPy's, JSON that is JSON."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.cli.diverged import KINDS, write_diverged_run

pytestmark = pytest.mark.slow


def hil(place: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """`hil` as a process in which a warning is an error."""
    done = subprocess.run(
        [sys.executable, "-m", "hil", *arguments], cwd=place, env=os.environ | {"PYTHONWARNINGS": "error"},
        capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    for word in ("Traceback", "Warning", "fault of hil"):
        assert word not in done.stderr, done.stderr
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


def test_score(place: Path, kind: str) -> None:
    for more in ([], ["--json"]):
        done = hil(place, "score", "run", "--truth", "run-truth.arrow", *more)
        assert done.returncode in (0, 1), done.stderr
    result = strict(done.stdout)
    assert strict((place / "run" / "result.json").read_text(encoding="utf-8")) == result
    assert result["parameters"] == {} or kind == "huge"
    page = (place / "run" / "report.html").read_text(encoding="utf-8")
    assert page.count("<figure ") >= 5
    assert "nan" not in page.partition("</style>")[2].lower().replace("nanos", "")


@pytest.mark.parametrize("more", [["check", "run"], ["export", "run", "-o", "out.csv"]], ids=lambda more: more[0])
def test_check_and_export(place: Path, more: list[str]) -> None:
    done = hil(place, *more, "--json")
    assert done.returncode == 0, done.stderr
    strict(done.stdout)
