"""`hil trace` from end to end: records that cannot be traced, one that lacks nothing, and one that lacks something."""

import json
from pathlib import Path

import numpy as np
import pytest

from hil.bench import load_bench
from hil.records.runfolder import RunFolder
from tests.cli.conftest import Hil, in_lockstep

RATE = 4000.0


def imported(hil: Hil, seconds: float = 3.0, volts: float = 0.089, clip: float = 1.0, frequency: float = 200.0) -> str:
    """A two-axis record as CSV, brought in; its name."""
    t = np.arange(round(seconds * RATE)) / RATE
    random = np.random.default_rng(3)
    swing = volts * np.cos(2 * np.pi * frequency * t)[:, None] * np.stack([np.cos(2 * t), np.sin(2 * t)], axis=1)
    sense = np.clip(swing, -clip, clip) + (9e-5 * random.standard_normal(swing.shape) if clip == 1.0 else 0.0)
    table = np.column_stack([t, sense, random.standard_normal(swing.shape)])
    np.savetxt("ride.csv", table, delimiter=",", header="t_s,vx_V,vy_V,ux_mps2,uy_mps2", comments="", fmt="%.9g")
    code, _, err = hil("import", "ride.csv")
    assert code == 0, err
    return "ride.arrow"


@pytest.mark.moderate
@pytest.mark.parametrize(
    ("record", "says"),
    [
        ({"seconds": 0.02}, "too short"),
        ({"volts": 1e-5}, "nothing moves"),
        ({"clip": 0.07}, "is clipped"),
        ({"frequency": 1500.0}, "sampled too slowly"),
    ],
)
def test_a_record_that_cannot_be_traced_is_one_line(
    hil: Hil, tmp_path: Path, record: dict[str, float], says: str
) -> None:
    name = imported(hil, **record)
    code, out, err = hil("trace", name, "--bench", "s-slow")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert err.startswith(f"hil: {name}: ")
    assert says in err
    assert "record" in err
    assert not (tmp_path / "runs").exists()


@pytest.mark.moderate
def test_no_number_of_workers_is_one_line(hil: Hil, monkeypatch: pytest.MonkeyPatch) -> None:
    name = imported(hil)
    monkeypatch.setenv("GYROHIL_WORKERS", "many")
    code, out, err = hil("trace", name, "--bench", "s-slow")
    assert (code, out) == (2, "")
    assert err == "hil: GYROHIL_WORKERS=many: no number of workers; give a whole number from 1 on, or leave it out\n"


@pytest.mark.moderate
def test_what_is_asked_is_checked_first(hil: Hil, tmp_path: Path) -> None:
    name = imported(hil)
    (tmp_path / "there.bench.toml").write_text("", encoding="utf-8")
    for arguments, says in (
        (("--bench", "s-slow", "--add", "there.bench.toml"), "exists already"),
        (("--bench", "s-slow", "--fraction", "1.5"), "no share of the record"),
        (("--bench", "silverbox"), "a record of 2 axes"),
        (("--bench", "nowhere"), "no such bench file"),
        (("--bench", "s-slow", "--arm"), "belong to --live"),
        (("--bench", "s-slow", "--live", "--link", "serial:/dev/null"), "needs --arm"),
    ):
        code, out, err = hil("trace", name, *arguments)
        assert (code, out) == (2, ""), err
        assert says in err
        assert err.count("\n") == 1


@pytest.mark.long
def test_a_record_that_lacks_nothing_is_adequate(hil: Hil, recorded: Path) -> None:
    code, out, err = hil("trace", str(recorded), "--bench", "s-slow", "--add", "new.bench.toml", "--json")
    assert code == 0, err
    diagnosis = json.loads(out)
    assert (diagnosis["verdict"], diagnosis["effects"]) == ("adequate", [])
    assert diagnosis["held_out"]["before"]["ratio"] == pytest.approx(1.0, abs=0.1)
    assert "not written; there is nothing to add" in err
    assert not Path("new.bench.toml").exists()


@pytest.mark.timeout(900)  # two runs, a trace, two scores
@pytest.mark.long
def test_what_is_missing_is_named_added_and_gone_in_the_next_run(hil: Hil, tmp_path: Path) -> None:
    source = in_lockstep("s-undeclared", duration_s=5.0, settle_s=2.0)
    source = source.replace("estimate_every = 40", "estimate_every = 1")  # the trace counts every sample
    (tmp_path / "mine.bench.toml").write_text(source, encoding="utf-8")
    board = ("--link", "inproc:s-undeclared", "--json")
    code, out, err = hil("run", "mine.bench.toml", *board, "--truth", "before.arrow")
    assert code == 1, err  # the residual is beyond its limit
    before = Path("runs") / json.loads(out)["run"]
    code, out, err = hil("trace", str(before), "--bench", "mine.bench.toml", "--add", "new.bench.toml")
    assert code == 0, err
    assert "cubic_stiffness" in out
    assert "\\n" not in out
    assert "\n\nthe residual without it\n" in out
    (folder,) = Path("runs").glob("*-trace")
    assert {path.name for path in folder.iterdir()} == {"bench.toml", "diagnosis.json", "report.html"}
    diagnosis = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    assert diagnosis["verdict"] == "explained"
    (effect,) = diagnosis["effects"]
    for symbol, true in (("k3x", 1e13), ("k3y", 3e12)):
        assert effect["coefficients"][symbol]["value"] == pytest.approx(true, rel=0.03)
    assert diagnosis["held_out"]["before"]["ratio"] > 2.0
    assert diagnosis["held_out"]["after"]["ratio"] < 1.05
    assert "cubic_stiffness" in load_bench(Path("new.bench.toml")).effects.named
    code, out, err = hil("replay", str(before), "--bench", "new.bench.toml", "--json")
    assert code == 0, err
    with_it = RunFolder.open(Path("runs") / json.loads(out)["run"]).estimates
    without = RunFolder.open(before).estimates
    assert with_it is not None
    assert without is not None
    moved = with_it.settled(2.0)["angle_rad"] - without.settled(2.0)["angle_rad"]
    largest = np.max(np.abs(moved - moved[0]))
    assert diagnosis["angle_moved_rad"] == pytest.approx(largest, rel=1e-3)
    code, out, err = hil("run", "new.bench.toml", *board, "--truth", "after.arrow")
    assert code == 0, err
    errors = []
    for run, truth in ((before, "before.arrow"), (Path("runs") / json.loads(out)["run"], "after.arrow")):
        _, out, _ = hil("score", str(run), "--truth", truth, "--json")
        errors.append(json.loads(out)["angle_error_rms_rad"])
    assert errors[1] < errors[0] / 50.0


@pytest.mark.long
def test_a_trace_leaves_nothing_when_the_record_is_none(hil: Hil, recorded: Path, tmp_path: Path) -> None:
    (recorded / "capture.arrow").write_bytes(b"no arrow")
    code, out, err = hil("trace", str(recorded), "--bench", "s-slow")
    assert (code, out) == (2, "")
    assert "capture.arrow" in err
    assert [path.name for path in (tmp_path / "runs").iterdir()] == [recorded.name]


@pytest.mark.slow
def test_a_rate_sensor_is_traced_by_its_curve(hil: Hil, tmp_path: Path) -> None:
    """A steady table with a cubic characteristic of 2 % at full range."""
    rates = np.repeat(np.linspace(-3.49, 3.49, 15), 4)
    random = np.random.default_rng(6)
    volts = 2.5 + 0.6 * (rates + 0.02 * rates**3 / 3.49**2) + 2e-4 * random.standard_normal(rates.shape)
    np.savetxt("table.csv", np.column_stack([rates, volts]), delimiter=",", header="rate,volts", comments="")
    Path("table.map.toml").write_text(
        'hold = "zoh"\nsteady = true\n[columns]\nrate_rad_s = { column = "rate", unit = "rad/s" }\n'
        'vx_V = { column = "volts", unit = "V" }\n',
        encoding="utf-8",
    )
    Path("sensor.bench.toml").write_text(
        '[device]\nname = "curved"\naxes = 0\nscale_V_s_per_rad = 0.6\noffset_V = 2.5\nrange_rad_s = 3.49\n'
        "noise_V = 2e-4\n",
        encoding="utf-8",
    )
    assert hil("import", "table.csv", "--map", "table.map.toml")[0] == 0
    code, out, err = hil("trace", "table.arrow", "--bench", "sensor.bench.toml", "--json")
    assert code == 0, err
    diagnosis = json.loads(out)
    assert diagnosis["verdict"] == "explained"
    assert [effect["name"] for effect in diagnosis["effects"]] == ["cubic"]
    assert diagnosis["held_out"]["after"]["ratio"] < 0.2 * diagnosis["held_out"]["before"]["ratio"]
    (folder,) = (tmp_path / "runs").iterdir()
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Residual against the rate" in page
    assert "[effects.cubic]" not in page
    code, out, err = hil("trace", "table.arrow", "--bench", "sensor.bench.toml", "--add", "new.bench.toml")
    assert (code, out) == (2, "")
    assert "no observer" in err
