"""`hil ls`, `hil show`, `last` wherever a run is named, and `hil --version` (docs/reference/cli.md)."""

import json
from importlib.metadata import version
from pathlib import Path

import pytest

from hil.records.listing import last_run, listed
from tests.cli.conftest import Hil
from tests.cli.test_errors import refused
from tests.records.synthetic_run import Options, write_run

EARLIER, LATER = "20260101-000000-a", "20260102-000000-b"


def two_runs(place: Path) -> Path:
    """Two runs, the later one without a result, a trace folder that cannot be read, and what is no run."""
    runs = place / "runs"
    write_run(runs / EARLIER, Options(seconds=2.0))
    write_run(runs / LATER, Options(seconds=2.0, result=False))
    sick = runs / "20260103-000000-c"
    sick.mkdir()
    (sick / "diagnosis.json").write_text("{}", encoding="utf-8")
    (runs / "notes").mkdir()
    return runs


@pytest.mark.moderate
def test_the_runs_of_a_folder_oldest_first(hil: Hil, tmp_path: Path) -> None:
    runs = two_runs(tmp_path)
    found = list(listed(runs))
    assert [one.path.name for one in found] == [EARLIER, LATER, "20260103-000000-c"]
    assert [one.kind for one in found] == ["run", "run", "trace"]
    assert found[0].seconds == pytest.approx(2.0, abs=1e-3)
    assert found[1].verdict == ""
    assert "diagnosis.json" in found[2].unreadable
    code, out, _ = hil("ls", "--json")
    assert code == 0
    assert [one["verdict"] for one in json.loads(out)["runs"]] == [found[0].verdict or None, None, None]
    code, out, _ = hil("ls")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()] == [one.path.name for one in found]
    assert "no verdict yet" in out.splitlines()[1]


@pytest.mark.moderate
def test_last_is_the_newest_run_whatever_was_touched_since(hil: Hil, tmp_path: Path) -> None:
    runs = two_runs(tmp_path)
    (runs / EARLIER / "note").write_text("touched", encoding="utf-8")
    assert last_run(runs).name == LATER
    code, _, err = hil("export", "last", "--out", "last.csv")
    assert code == 0, err
    assert (tmp_path / "last.csv").exists()
    assert f"hil replay runs/{LATER}" in refused(hil("show", "last"))


@pytest.mark.moderate
def test_a_folder_that_is_called_last_is_that_folder(hil: Hil, tmp_path: Path) -> None:
    two_runs(tmp_path)
    write_run(tmp_path / "last", Options(seconds=2.0))
    code, out, _ = hil("show", "last", "--json")
    assert code in (0, 1)
    assert json.loads(out)["run"] == json.loads((tmp_path / "last" / "result.json").read_text(encoding="utf-8"))["run"]


@pytest.mark.moderate
def test_a_run_is_shown_again_with_its_own_exit_code(hil: Hil, tmp_path: Path) -> None:
    runs = two_runs(tmp_path)
    code, out, _ = hil("show", str(runs / EARLIER))
    verdict = next(iter(listed(runs))).verdict
    assert code == (0 if verdict in ("", "good") else 1)
    assert "8000 samples" in out


@pytest.mark.moderate
def test_nothing_there_is_said_in_one_line(hil: Hil, tmp_path: Path) -> None:
    assert refused(hil("ls")).startswith("runs: no such folder")
    (tmp_path / "runs").mkdir()
    assert refused(hil("score", "last", "--truth", "truth.arrow")).startswith("last: no run in runs/")
    code, out, _ = hil("ls")
    assert (code, out) == (0, "runs: no runs yet; next: hil run s-slow\n")


def test_the_version(hil: Hil) -> None:
    assert hil("--version") == (0, f"gyrohil {version('gyrohil')}\n", "")
