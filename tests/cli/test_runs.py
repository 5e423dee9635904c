"""`hil ls`, `hil show`, `last` wherever a run is named, and `hil --version` (docs/reference/cli.md)."""

import json
import shutil
from importlib.metadata import version
from pathlib import Path

import pytest

from hil.comparing import methods as comparing
from hil.errors import InputError
from hil.records.attitude import AttitudeResult, save_attitude_result
from hil.records.data_sheet import DataSheet, save_data_sheet
from hil.records.diagnosis import Diagnosis
from hil.records.runs import last_run, listed
from hil.service.catalogue.entry import read_entry
from tests.cli.conftest import Hil
from tests.cli.diagnoses import explained, save_trace
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
    assert "no figures" in out.splitlines()[1]


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
def test_the_last_trace_is_the_newest_trace(hil: Hil, tmp_path: Path) -> None:
    runs = two_runs(tmp_path)
    (runs / "20260103-000000-c" / "diagnosis.json").unlink()
    save_trace(runs / "20251231-000000-a-trace", explained(record="older"))
    save_trace(runs / "20260101-120000-a-trace", explained(record="newer"))
    code, out, err = hil("show", "last-trace", "--json")
    assert (code, json.loads(out)["record"]) == (0, "newer"), err
    assert f"hil replay runs/{LATER}" in refused(hil("show", "last"))  # the newest run, as ever
    code, out, err = hil("diff", "last-trace", "runs/20251231-000000-a-trace", "--json")
    assert (code, json.loads(out)["a"]) == (0, "runs/20260101-120000-a-trace"), err


@pytest.mark.moderate
def test_no_trace_yet_is_said_in_one_line(hil: Hil, tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / EARLIER, Options(seconds=2.0))
    assert refused(hil("show", "last-trace")) == (
        "last-trace: no trace in runs/; make one (hil trace last), or name its folder"
    )


@pytest.mark.moderate
def test_the_last_run_is_checked(hil: Hil, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    write_run(runs / EARLIER, Options(seconds=2.0))
    shutil.copytree(runs / EARLIER, runs / LATER)
    (runs / LATER / "innovation.arrow").unlink()
    for place in ("last", f"runs/{LATER}"):
        code, out, err = hil("check", place, "--json")
        assert code in (0, 1), err
        assert "innovation.arrow" not in [one["name"] for one in json.loads(out)["files"]]


@pytest.mark.moderate
def test_a_comparison_takes_the_last_trace(hil: Hil, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_run(tmp_path / "runs" / EARLIER, Options(seconds=2.0))
    save_trace(tmp_path / "runs" / LATER, explained(record="the last"))

    def taken(*_: object, diagnosis: Diagnosis, **__: object) -> None:
        raise InputError(f"carried from {diagnosis.record}")

    monkeypatch.setattr(comparing, "compare", taken)
    for word in ("last", "last-trace", f"runs/{LATER}"):
        assert refused(hil("compare", "last", "--bench", "s-slow", "--diagnosis", word)) == "carried from the last"


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


@pytest.mark.moderate
def test_every_name_that_is_listed_is_taken_and_its_beginning_too(hil: Hil, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    write_run(runs / EARLIER, Options(seconds=2.0))
    write_run(runs / f"{EARLIER}-again", Options(seconds=2.0))
    save_trace(runs / f"{EARLIER}-trace", explained(record="a"))
    _, out, _ = hil("ls")
    named = [line.split()[0] for line in out.splitlines()]
    assert named == [EARLIER, f"{EARLIER}-again", f"{EARLIER}-trace"]
    for name in named:
        code, text, err = hil("show", name, "--json")
        assert (code, bool(json.loads(text))) == (json.loads(text)["verdict"] in ("failed", "unexplained"), True), err
    assert hil("diff", *named[:2], "--json")[0] == 0
    assert hil("export", named[0], "--out", "a.csv")[0] == 0
    assert hil("show", f"{EARLIER}-ag")[0] == hil("show", f"runs/{EARLIER}-again")[0]
    line = refused(hil("show", EARLIER[:-1]))
    assert line == (f"{EARLIER[:-1]}: 3 in runs/ begin with it: {', '.join(named)}; give more of the name")


@pytest.mark.moderate
def test_runs_of_another_folder_are_listed_by_what_show_takes(hil: Hil, tmp_path: Path) -> None:
    write_run(tmp_path / "bench3" / "runs" / EARLIER, Options(seconds=2.0))
    _, out, _ = hil("ls", "bench3/runs")
    assert out.split()[0] == f"bench3/runs/{EARLIER}"
    assert "result.json" not in hil("show", out.split()[0])[2]


@pytest.mark.moderate
def test_the_part_that_failed_and_its_reason_are_listed(hil: Hil, tmp_path: Path) -> None:
    from hil.records.result import Part, load_result, save_result

    write_run(tmp_path / "runs" / EARLIER, Options(seconds=2.0))
    path = tmp_path / "runs" / EARLIER / "result.json"
    part = Part(outcome="failed", reason="6.6 % of answers late", next="")
    save_result(path, load_result(path).model_copy(update={"verdict": "failed", "parts": {"machine": part}}))
    _, out, _ = hil("ls")
    assert "failed: machine" in out
    assert out.rstrip().endswith("6.6 % of answers late")
    _, text, _ = hil("ls", "--json")
    assert json.loads(text)["runs"][0]["against"] == ["machine"]
    assert json.loads(text)["runs"][0]["reasons"] == ["6.6 % of answers late"]


def test_what_is_no_run_is_listed_by_its_kind(hil: Hil, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    sheet = DataSheet(device="d", records=("r",), seconds=60.0, verdict="failed", rows=())
    attitude = AttitudeResult(verdict="good", axes=(), seconds=9.0)
    for name in ("20260101-000000-sheet", "20260102-000000-board", "20260103-000000-three"):
        (runs / name).mkdir(parents=True)
    save_data_sheet(runs / "20260101-000000-sheet" / "characteristics.json", sheet)
    found = json.dumps({"faults": ["the latency is 3 ticks"]})
    (runs / "20260102-000000-board" / "identified.json").write_text(found, encoding="utf-8")
    save_attitude_result(runs / "20260103-000000-three", attitude)
    code, out, _ = hil("ls", "--json")
    assert code == 0
    rows = json.loads(out)["runs"]
    assert [(one["kind"], one["verdict"]) for one in rows] == [
        ("sheet", "failed"), ("identify", "failed"), ("attitude", "good")
    ]  # fmt: skip
    assert rows[1]["reasons"] == ["the latency is 3 ticks"]
    assert "open runs/20260102-000000-board/report.html" in refused(hil("show", "20260102"))
    entries = [read_entry(runs / Path(one["path"]).name) for one in rows]
    assert [(one.kind, one.verdict, one.state) for one in entries] == [
        ("sheet", "failed", "done"), ("identify", "failed", "done"), ("attitude", "good", "done")
    ]  # fmt: skip
    (runs / "20260102-000000-board" / "identified.json").write_text("{", encoding="utf-8")
    assert "identify the board again" in str(read_entry(runs / "20260102-000000-board").details["unreadable"])
