"""Each verb from end to end, in lockstep and briefly."""

import json
import re
from pathlib import Path

import pytest

from hil.bench import load_bench
from hil.bench.examples import find
from tests.cli.conftest import Hil

pytestmark = pytest.mark.slow  # whole processes

DEMO_KEYS = {
    "run", "link", "clock", "seconds", "samples", "lost", "late", "angle_error_rms_rad",
    "rate_error_rms_rad_s", "parameters", "innovation_rms", "noise_floor", "turnaround_us", "diagnosis",
}  # fmt: skip


def test_run_leaves_a_whole_folder(recorded: Path) -> None:
    names = {path.name for path in recorded.iterdir()}
    assert names == {
        "bench.toml", "capture.arrow", "estimates.arrow", "innovation.arrow", "timing.arrow", "result.json",
        "report.html", "covariance.arrow",
    }  # fmt: skip
    assert recorded.name.endswith("-short")
    result = json.loads((recorded / "result.json").read_text(encoding="utf-8"))
    assert (result["samples"], result["lost"], result["late"]) == (12000, 0, 0)
    assert (result["verdict"], result["complete"], result["operator_note"]) == ("good", True, "n")
    bench = load_bench(recorded / "bench.toml")
    assert (bench.loop.clock, bench.loop.duration_s, bench.device.normalised) == ("lockstep", 3.0, True)


@pytest.mark.long
def test_score_puts_the_truth_beside(hil: Hil, recorded: Path) -> None:
    code, out, _ = hil("score", str(recorded), "--truth", "truth.arrow", "--json")
    assert code == 0
    result = json.loads(out)
    assert result.keys() >= DEMO_KEYS
    assert result["parameters"]["kxx"]["truth"] == pytest.approx(1610719.4)
    assert result["angle_error_rms_rad"] < 0.01
    assert result["diagnosis"] is None


@pytest.mark.long
def test_figures_are_readable_without_json(hil: Hil, recorded: Path) -> None:
    code, out, err = hil("score", str(recorded), "--truth", "truth.arrow")
    assert code == 0
    assert err == ""
    for word in ("angle error, rms", "95 % interval", "kxx", "verdict  good", "report.html"):
        assert word in out


@pytest.mark.long
def test_replay_finds_what_the_run_found(hil: Hil, recorded: Path, short_bench: str) -> None:
    before = json.loads((recorded / "result.json").read_text(encoding="utf-8"))
    code, out, _ = hil("replay", str(recorded), "--bench", short_bench, "--out", "again", "--json")
    assert code == 0
    after = json.loads(out)
    assert after["run"].endswith("-short-replay")
    assert after["samples"] == before["samples"]
    for name, parameter in before["parameters"].items():
        assert after["parameters"][name]["value"] == pytest.approx(parameter["value"], rel=1e-6)


def test_export_and_import_are_inverse(hil: Hil, recorded: Path, short_bench: str) -> None:
    code, out, _ = hil("export", str(recorded), "--to", "csv", "-o", "ride.csv", "--json")
    left_out = ["the latency of its drive", "who recorded it"]
    told = {"file": "ride.csv", "rows": 12000, "tables": {"capture": 12000}, "left_out": left_out, "cut": []}
    assert (code, json.loads(out)) == (0, told)
    code, out, _ = hil("import", "ride.csv", "--json")
    figures = json.loads(out)
    assert code == 0
    assert (figures["capture"], figures["samples"], figures["axes"]) == ("ride.arrow", 12000, 2)
    assert figures["tick_rate_Hz"] == pytest.approx(4000.0)
    code, _, err = hil("replay", "ride.arrow", "--bench", short_bench)
    assert code == 0, err


def test_dry_run_shows_the_board_and_leaves_nothing(hil: Hil, short_bench: str, tmp_path: Path) -> None:
    code, out, _ = hil("run", short_bench, "--link", "inproc:s-slow", "--dry-run", "--json")
    assert code == 0
    answer = json.loads(out)
    assert answer["identity"]["tick_rate_Hz"] == 4000.0
    assert [path.name for path in tmp_path.iterdir()] == [short_bench]
    code, out, _ = hil("run", short_bench, "--link", "inproc:s-slow", "--dry-run")
    assert re.search(r"^ +firmware +1\.0\.0$", out, re.MULTILINE)


@pytest.mark.long
def test_open_loop_drives_nothing(hil: Hil, short_bench: str, tmp_path: Path) -> None:
    from hil.records.capture import read_capture

    code, out, err = hil("run", short_bench, "--link", "inproc:s-slow", "--open-loop")
    assert code == 0, err  # it has no angle to judge, and says so
    assert "no angle to judge" in " ".join((out + err).split())
    (folder,) = (tmp_path / "runs").iterdir()
    assert not read_capture(folder / "capture.arrow").drive.any()


@pytest.mark.parametrize(("file", "name"), [("left.bench.toml", "left"), ("My gyro (2).toml", "My-gyro-2-")])
def test_a_bench_file_is_called_by_its_file(hil: Hil, tmp_path: Path, file: str, name: str) -> None:
    """With every number given nothing is left to be filled in."""
    numbers = {"resonance": 15000, "q": 5000, "mass": 1e-8, "amplitude": 1e-6, "sample-rate": 1e5, "sense-gain": 1e5,
               "noise": 1e-4, "full-scale": 100}  # fmt: skip
    given = [word for option, value in numbers.items() for word in (f"--{option}", str(value))]
    code, out, _ = hil("init", *given, "-o", file, "--json")
    assert (code, json.loads(out)["missing"]) == (0, [])
    bench = load_bench(tmp_path / file)
    assert (bench.device.name, bench.loop.name) == (name, name)
    hil("init", "--like", "s-slow", "--name", "mine", "-o", file, "--replace")
    bench = load_bench(tmp_path / file)
    assert (bench.device.name, bench.loop.name) == ("mine", load_bench(find("bench", "s-slow")).loop.name)


def test_init_from_board_fills_in_what_it_says(hil: Hil, tmp_path: Path) -> None:
    code, out, _ = hil("init", "--from-board", "--link", "inproc:s-slow", "--json")
    assert code == 0
    assert "[device] mass_kg" in json.loads(out)["missing"]
    code, out, _ = hil("init", "--from-board", "--link", "pty:s-slow", "--like", "s-slow", "-o", "b.toml", "--json")
    assert (code, json.loads(out)["missing"]) == (0, [])
    bench = load_bench(tmp_path / "b.toml")
    assert bench.link.url == "pty:s-slow"
    assert bench.device.drive.full_scale == pytest.approx(10.0)


def test_bench_that_does_not_fit_the_board_is_refused(hil: Hil, short_bench: str, tmp_path: Path) -> None:
    code, out, err = hil("run", short_bench, "--link", "inproc:s-classic")
    assert (code, out) == (2, "")
    assert err.splitlines()[-1].startswith("hil: ")
    assert "sample_rate_Hz" in err
    assert not list(tmp_path.glob("runs/*"))
