"""Campaigns run: the same bytes by one worker and by two, rows as of a run by itself, other readers."""

import hashlib
import json
import resource
import signal
import tomllib
from pathlib import Path

import numpy as np
import pytest

import hil
from hil import cli
from hil.errors.ending import line_of
from hil.records.runfolder import RunFolder
from hil.records.truth import read_truth
from hil.sweeping.one_run import carry_out
from hil.sweeping.plan import toml_of
from tests.campaigns.conftest import bytes_in
from tests.campaigns.small import RUNS, plan, small


@pytest.mark.long
def test_two_workers_give_the_bytes_of_one(swept: hil.Sweep, whole: dict[str, bytes], tmp_path: Path) -> None:
    two = hil.sweep(RUNS, out=tmp_path / "two", workers=2)
    assert len(whole) == 6
    assert bytes_in(two.path) == whole
    assert {file.name for file in two.path.iterdir()} == {"campaign.json", "lock", "results", "wall.jsonl"}
    assert set(swept.table["outcome"].to_pylist()) == {"ran"}


@pytest.mark.long
def test_pandas_polars_and_duckdb_read_the_same_rows(swept: hil.Sweep) -> None:
    import duckdb  # here, so that no process that only collects this loads the three
    import pandas as pd
    import polars as pl

    results = swept.path / "results"
    a = pd.read_parquet(results)
    b = pl.read_parquet(results / "**/*.parquet", hive_partitioning=True)
    c = duckdb.sql(f"select * from read_parquet('{results}/*/*.parquet', hive_partitioning=true) order by run")
    assert (
        sorted(a["file"].astype(int))
        == [*([0] * 3), *([1] * 3), *([2] * 3), *([3] * 3), *([4] * 3), 5]
        == b.sort("run")["file"].to_list()
    )
    expected = swept.table["rate_error_rms_rad_s"].to_pylist()
    assert a.sort_values("run")["rate_error_rms_rad_s"].to_list() == expected
    assert b.sort("run")["rate_error_rms_rad_s"].to_list() == expected
    assert [row[0] for row in c.project("rate_error_rms_rad_s").fetchall()] == expected
    assert swept.to_pandas().index.name == "run"


@pytest.mark.long
def test_a_run_made_again_by_hil_run_is_the_one_in_the_campaign(
    swept: hil.Sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """`--only`: scenario and bench as files, run by the loop's own process, scored: another way to the same figures."""
    monkeypatch.chdir(tmp_path)
    text = toml_of(RUNS, "A campaign.")
    (tmp_path / "small.campaign.toml").write_text(text)
    assert tomllib.loads(text) == RUNS
    assert swept.worst[0].command.startswith("hil sweep small --only ")
    cli.execute(["sweep", "small.campaign.toml", "--only", "6", "--out", str(swept.path), "--json"])
    said = capfd.readouterr()
    assert "its record is that of the campaign, byte for byte" in said.err
    (folder,) = (tmp_path / "runs").iterdir()
    assert {"board.scenario.toml", "truth.arrow", "report.html"} <= {file.name for file in folder.iterdir()}
    row, result = swept.table.slice(6, 1).to_pylist()[0], json.loads(said.out)
    assert row["record_sha256"] == hashlib.sha256((folder / "capture.arrow").read_bytes()).hexdigest()
    assert row["angle_error_rms_rad"] == result["angle_error_rms_rad"]
    assert row["rate_error_rms_rad_s"] == result["rate_error_rms_rad_s"]
    assert row["nees"] == result["score"]["nees"]["mean"]
    assert row["samples"] == result["samples"] == 1600
    # At the end and on the way, worked out anew from the estimates and the truth.
    estimates, true = RunFolder(folder).estimates, read_truth(folder / "truth.arrow")
    assert estimates is not None
    tick = estimates.tick
    there = np.searchsorted(true.tick, tick)
    error = estimates["rate_rad_s"] - true["rate_rad_s"][there]
    assert row["error_rate_rad_s"] == error[-1]
    late = np.abs(error) > 4.0 * row["sd_rate_rad_s"]
    settled = next(place for place in range(len(error)) if not late[place:].any())
    assert row["converged_s"] == tick[settled] / 4000.0
    scenario = tomllib.loads((folder / "board.scenario.toml").read_text())
    assert scenario["sense"]["noise_V"] == row["noise_V"]
    assert row["error_kxx_per_s2"] == estimates["kxx_per_s2"][-1] - scenario["truth"]["stiffness_N_per_m"][0] / 1e-3
    angle = estimates["angle_rad"] - true["angle_rad"][there]
    assert row["angle_error_end_rad"] == pytest.approx(angle[-1] - angle[tick / 4000.0 >= 0.1][0], abs=1e-15)


def test_a_run_that_is_not_there_is_told(capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.execute(["sweep", "s-slow-noise", "--only", "36"]) == 2
    assert "no run 36; its runs are 0 to 35" in capfd.readouterr().err


@pytest.mark.slow
def test_what_the_board_refuses_is_a_row_and_the_exit_code_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    vary = [{"key": "scenario.sense.adc_bits", "name": "bits", "values": [16, 99]}]
    table = small(vary=vary, seeds=1, name="bits")
    (tmp_path / "bits.campaign.toml").write_text(toml_of(table, "A campaign."))
    assert cli.execute(["sweep", "bits.campaign.toml", "--workers", "1", "--json"]) == 1
    told = json.loads(capfd.readouterr().out)
    assert told["outcomes"] == {"ran": 1, "refused": 1}
    assert told["worst"][0] == {
        "run": 1, "outcome": "refused", "value": None, "command": "hil sweep bits.campaign.toml --only 1",
    }  # fmt: skip
    (_, refused) = hil.sweep(table, out="runs/bits").table.to_pylist()
    assert "adc_bits" in refused["reason"]
    assert str(tmp_path) not in refused["reason"]
    assert "tmp" not in refused["reason"]
    page = Path("runs/bits/report.html").read_text()
    assert "adc_bits" in page
    assert cli.execute(["sweep", "bits.campaign.toml", "--json"]) == 1  # nothing is left to do
    assert json.loads(capfd.readouterr().out)["made"] == 0


@pytest.mark.moderate
def test_a_key_unknown_to_the_board_is_told_first(tmp_path: Path) -> None:
    table = small(vary=[{"key": "scenario.sense.nosie_V", "values": [1e-4, 1e-3]}])
    with pytest.raises(hil.InputError, match="nosie_V: unknown key; did you mean"):
        hil.sweep(table, out=tmp_path / "a", workers=1)
    assert not (tmp_path / "a" / "results").exists()


@pytest.mark.moderate
def test_the_dry_run_lists_all_and_makes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.execute(["sweep", "s-slow-noise", "--dry-run", "--json"]) == 0
    runs = json.loads(capfd.readouterr().out)["runs"]
    assert len(runs) == 36
    assert {run["noise_V"] for run in runs} == {3e-5, 9e-5, 9e-4}
    assert cli.execute(["sweep", "s-slow-noise", "--dry-run"]) == 0
    assert capfd.readouterr().out.startswith("s-slow-noise: 36 runs of 8000 samples, into runs/s-slow-noise\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_the_report_opens_alone_and_has_each_worst_run_with_its_command(swept: hil.Sweep) -> None:
    page = swept.report().read_text()
    assert "http" not in page.replace("http://www.w3.org", "").replace("https://www.w3.org", "")
    for one in swept.worst:
        assert f"<td>{one.command}</td>" in page
    values = [abs(one.value) for one in swept.worst if one.value is not None]
    assert values == sorted(values, reverse=True)
    assert values[0] == max(swept.table["angle_error_rms_rad"].to_pylist())
    assert swept.dependence is not None
    with pytest.raises(hil.InputError, match="no such column; did you mean angle_error_rms_rad"):
        swept.dependence_of("angle_error_rms")
    swept.report().unlink()


@pytest.mark.long
def test_bound_initial_values_and_scan_of_a_run(swept: hil.Sweep) -> None:
    each = {"bound": True, "drawn_initial": True}
    fixed = small()["fixed"] | {"bench.observer.gain": "ekf"}
    made, scanned = plan(small(each=each, fixed=fixed)), plan(small(each=each | {"scan": True}, fixed=fixed))
    row, judged = (carry_out(one.task(0)).row for one in (made, scanned))
    assert judged["verdict"] in ("good", "failed")
    assert judged["angle_u_rad"] > 0.0
    assert row == {name: value for name, value in judged.items() if name in row}
    assert row["record_sha256"] != swept.table["record_sha256"].to_pylist()[0]  # it began with other initial values
    for bound, sd in (("bound_rate_end_rad_s", "sd_rate_rad_s"),):
        assert row[bound] == pytest.approx(row[sd], rel=0.05)  # an EKF that has converged states the bound
    assert 0.0 < row["bound_pattern_end_rad"] < row["bound_pattern_rms_rad"]
    other = carry_out(made.task(1)).row
    assert other["error_kxx_per_s2"] != row["error_kxx_per_s2"]


@pytest.mark.parametrize("room", [200, 20_000], ids=["a file of the run", "the truth"])
def test_a_run_that_finds_no_room_has_no_row(room: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is to be made again, when there is room: what the disk does is no property of the device."""
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
        with pytest.raises(OSError, match="File too large") as raised:
            carry_out(plan().task(0))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert "give" in line_of(raised.value)
