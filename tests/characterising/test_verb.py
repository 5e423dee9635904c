"""`hil characterise` from records: what it tells, what it says that it cannot, limits, JUnit, bad input."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.signal import lfilter

import hil
from hil.bench.data_sheet import FIGURES
from hil.characterising.figures import shown
from hil.errors import InputError
from hil.records.capture import import_layout
from hil.records.data_sheet import load_data_sheet
from hil.records.layout import Column
from hil.records.rates import rates_layout
from hil.records.stream import BlockWriter
from tests.cli.conftest import hil as called  # noqa: F401

RATE_HZ = 100.0
SENSOR = """
[device]
name = "table sensor"
axes = 0
scale_V_s_per_rad = 0.5
range_rad_s = 3.0
noise_V = 1e-3
sample_rate_Hz = 100.0
"""


def still(path, seed, bias=2e-4, n=30_000, spikes=()):
    """A sensor at rest: white noise of 1e-4 rad/√s on two axes; x spikes by 0.1 rad/s."""
    scale = 1e-7
    channels = [Column(f"rate_{axis}_code", "i4", "rad/s", scale) for axis in "xy"]
    layout = rates_layout(channels, tick_rate_Hz=RATE_HZ, device="a sensor")
    path.mkdir()
    noise = 1e-4 * np.sqrt(RATE_HZ) * np.random.default_rng(seed).standard_normal((n, 2))
    noise[list(spikes), 0] += 0.1
    rows = np.zeros(n, layout.dtype)
    rows["tick"] = np.arange(n)
    for k, axis in enumerate("xy"):
        rows[f"rate_{axis}_code"] = np.round((bias + noise[:, k]) / scale)
    with BlockWriter(path / "capture.arrow", layout) as writer:
        writer.push(rows)
    return path


def on_a_table(path, seed):
    """White noise of 1e-4 rad/√s behind one pole at 5 Hz and 20 ms, curved by 0.05 %, on a table that dwells for 20 s
    and ramps for 2 s, and shakes at last, faster than 0.1 s shows."""
    n = 24_000
    rate = np.repeat(np.array([-2, -1, -0.5, 0, 0.5, 1, 2, 0, 1.5, -1.5]), n // 10)
    hann = np.hanning(200) / np.hanning(200).sum()
    rate = np.convolve(np.pad(rate, 200, "edge"), hann, "same")[200:-200]
    t = np.arange(n) / RATE_HZ
    rate += np.where(t > 230.0, np.sin(2 * np.pi * 10.0 * t), 0.0)
    keep = np.exp(-2 * np.pi * 5.0 / RATE_HZ)
    late = rate[np.maximum(np.arange(n) - 2, 0)]
    output, _ = lfilter([1.0 - keep], [1.0, -keep], late, zi=[keep * late[0]])
    output = 1.001 * output + 5e-4 * 2 * (output / 2) ** 3
    output += 1e-4 * np.sqrt(RATE_HZ) * np.random.default_rng(seed).standard_normal(n)
    layout = import_layout(["vx_V", "rate_rad_s"], tick_rate_Hz=RATE_HZ, uniform=True, hold="zoh", segments={})
    rows = np.zeros(n, layout.dtype)
    rows["tick"], rows["rate_rad_s"], rows["vx_V"] = np.arange(n), rate, 0.5 * output
    with BlockWriter(path, layout) as writer:
        writer.push(rows)
    return path


def turned(path, n=24_000):
    """A sensor on a table that steps through 25 rates, with a scale factor 1 % too large."""
    rate = np.repeat(np.linspace(-2, 2, 25), n // 25 + 1)[:n]
    layout = import_layout(["vx_V", "rate_rad_s"], tick_rate_Hz=RATE_HZ, uniform=True, hold="zoh", segments={})
    rows = np.zeros(n, layout.dtype)
    rows["tick"], rows["rate_rad_s"] = np.arange(n), rate
    rows["vx_V"] = 0.505 * rate + 1e-3 * np.random.default_rng(3).standard_normal(n)
    with BlockWriter(path, layout) as writer:
        writer.push(rows)
    return path


def test_a_sensor_at_rest(tmp_path):
    sheet = hil.characterise([still(tmp_path / "a", 1), still(tmp_path / "b", 2, 5e-4)], out=tmp_path / "runs")
    walk, bias, turn_on = (sheet[name] for name in ("angle_random_walk", "bias", "bias_turn_on"))
    assert walk.value == pytest.approx(1e-4, rel=0.04)  # how often the interval holds it: tests/rate_sensor
    assert walk.low < walk.value < walk.high
    assert walk.sheet_value == pytest.approx(np.degrees(walk.value) * 60)
    assert walk.sheet_unit == "°/√h"
    assert bias.value == pytest.approx(3.5e-4, abs=3e-5)
    assert "at rest" in bias.said
    assert turn_on.value == pytest.approx(3e-4 / np.sqrt(2), rel=0.1)
    assert sheet["scale_factor_error"].value is None
    assert "reference" in sheet["scale_factor_error"].said
    assert {row.axis for row in sheet.sheet.rows} == {"x", "y"}
    assert load_data_sheet(sheet.path / "characteristics.json") == sheet.sheet
    page = (sheet.path / "report.html").read_text()
    assert page.count("<figure") == 2
    assert "angle random walk" in page


@pytest.mark.moderate
def test_the_noise_of_a_device_on_a_table_is_that_at_rest(tmp_path):
    (tmp_path / "sensor.bench.toml").write_text(SENSOR)
    held = []
    for seed in range(20):
        place, bench = on_a_table(tmp_path / f"{seed}.arrow", seed), tmp_path / "sensor.bench.toml"
        sheet = hil.characterise(place, bench, out=tmp_path / "runs", report=False)
        walk = sheet["angle_random_walk"]
        assert sheet["rate_random_walk"].value is None
        assert sheet["bias_instability"].low == 0.0
        held.append(walk.low <= 1e-4 <= walk.high)
    assert np.mean(held) >= 0.85
    assert walk.high < 1.1 * walk.low


def test_noise_under_a_rate_that_never_stands_still_is_not_determined(tmp_path):
    n = 12_000
    rate = np.sin(0.5 * np.arange(n) / RATE_HZ)
    layout = import_layout(["vx_V", "rate_rad_s"], tick_rate_Hz=RATE_HZ, uniform=True, hold="zoh", segments={})
    rows = np.zeros(n, layout.dtype)
    rows["tick"], rows["rate_rad_s"] = np.arange(n), rate
    rows["vx_V"] = 0.5 * rate + 1e-3 * np.random.default_rng(3).standard_normal(n)
    with BlockWriter(tmp_path / "sine.arrow", layout) as writer:
        writer.push(rows)
    (tmp_path / "sensor.bench.toml").write_text(SENSOR)
    sheet = hil.characterise(tmp_path / "sine.arrow", tmp_path / "sensor.bench.toml", out=tmp_path, report=False)
    assert sheet["angle_random_walk"].value is None
    assert sheet["angle_random_walk"].said == "the reference never stands still for 2 s"


def test_spikes_are_counted_and_left_out_of_the_noise(tmp_path):
    spiky = still(tmp_path / "a", 1, spikes=[100, 9_000, 20_000])
    sheet = hil.characterise(spiky, out=tmp_path / "runs", report=False)
    clean = hil.characterise(still(tmp_path / "b", 1), out=tmp_path / "runs", report=False)
    assert sheet["angle_random_walk"].value == pytest.approx(clean["angle_random_walk"].value, rel=2e-3)
    remarks = [remark for remark in sheet.sheet.remarks if "samples lie" in remark]
    assert len(remarks) == 1
    assert remarks[0].startswith("x: 3 of 30000 samples lie more than")
    assert "up to 5.8 °/s; the noise figures leave them out" in remarks[0]
    assert not [remark for remark in clean.sheet.remarks if "samples lie" in remark]


def test_a_table_that_steps_and_the_limits_of_its_data_sheet(tmp_path, called):  # noqa: F811
    """The limits decide the exit code and the test cases; a limit without its figure is not kept."""
    capture = turned(tmp_path / "table.arrow")
    bench = tmp_path / "sensor.bench.toml"
    limits = "[limits]\nscale_factor_error_ppm = {}\nbias_deg_per_h = 100.0\n"
    bench.write_text(SENSOR + limits.format(20_000.0))
    call = ["characterise", str(capture), "--bench", str(bench), "--json", "-o", str(tmp_path / "runs"), "--no-report"]
    junit = tmp_path / "sheet.xml"
    code, out, _ = called(*call, "--junit", str(junit))
    assert code == 0
    told = json.loads(out)
    rows = {row["figure"]: row for row in told["rows"]}
    assert rows["scale_factor_error"]["low"] <= 0.01 <= rows["scale_factor_error"]["high"]
    assert rows["scale_factor_error"]["limit"] == pytest.approx(0.02)
    assert rows["scale_factor_nonlinearity"]["value"] < 1e-3
    cases = ElementTree.parse(junit).findall(".//testcase")
    assert [case.get("name") for case in cases] == ["table sensor scale factor error", "table sensor bias"]
    bench.write_text(SENSOR + limits.format(5000.0) + "bias_instability_deg_per_h = 1e-6\nstart_up_s = 10.0\n")
    code, out, _ = called(*call, "--junit", str(junit), "--replace")
    assert code == 1
    told = json.loads(out)
    rows = {row["figure"]: row for row in told["rows"]}
    assert told["verdict"] == "failed"
    assert rows["scale_factor_error"]["kept"] is False
    assert rows["bias"]["kept"] is True
    assert rows["bias_instability"]["kept"] is False
    assert len(ElementTree.parse(junit).findall(".//failure")) == 2


@pytest.mark.slow
def test_a_whole_angle_run_needs_the_truth_that_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = hil.run("s-slow", link="inproc:s-slow", clock="lockstep", duration_s=24, truth="truth.arrow")
    without = hil.characterise(run, report=False)
    assert without.sheet.reference is None
    assert without["scale_factor_error"].value is None
    sheet = hil.characterise(run, truth=tmp_path / "truth.arrow", report=False)
    assert sheet.sheet.reference == "truth"
    error = sheet["scale_factor_error"]
    assert abs(error.value) < 0.02
    assert error.low < 0.0 < error.high


@pytest.mark.slow
def test_harmonics_that_are_not_told_apart_are_no_calibration(tmp_path, monkeypatch):
    """Ten seconds of one rate and two of the other: the pattern passes most angles, at each rate some of them."""
    monkeypatch.chdir(tmp_path)
    run = hil.run("s-slow", link="inproc:s-slow", clock="lockstep", duration_s=12, truth="truth.arrow")
    with pytest.raises(InputError, match="each way round"):
        hil.characterise(run, truth="truth.arrow", calibrate="calibrations", report=False)
    assert not Path("calibrations").exists()


def test_bad_input_is_told_in_a_line(tmp_path):
    folder = still(tmp_path / "a", 1, n=2000)
    for records, options, word in (
        ([tmp_path / "nothing"], {}, "no such"),
        ([folder], {"truth": ("a.arrow", "b.arrow")}, "truth: 2 for 1 runs"),
        ([folder], {"truth": "a.arrow"}, "no run of an emulated gyro"),
        ([folder], {"calibrate": tmp_path / "c"}, "does not tell what depends on the angle"),
        ([], {}, "no record"),
        ([turned(tmp_path / "t.arrow")], {}, "give a run of two axes"),
        (["nobody:/dev/null"], {}, "no adapter of that name"),
    ):
        with pytest.raises(InputError, match=word):
            hil.characterise(records, out=tmp_path / "runs", report=False, **options)
    assert not list((tmp_path / "runs").glob("*")) if (tmp_path / "runs").exists() else True


def test_every_figure_has_its_unit_and_its_clause():
    assert len({figure.key for figure in FIGURES}) == len(FIGURES)
    for figure in FIGURES:
        assert figure.clause.startswith("IEEE Std")
        assert figure.shown(1.0) == pytest.approx(figure.field.per_model_unit)


def test_a_record_that_is_too_short_says_how_long_one_has_to_be(tmp_path):
    """Records of the length that is named tell the figure."""

    def told(*lengths):
        folder = tmp_path / "-".join(map(str, lengths))
        folder.mkdir()
        records = [still(folder / str(k), k, n=n) for k, n in enumerate(lengths)]
        return hil.characterise(records, out=tmp_path / "runs", report=False)

    assert told(30)["bias"].said == "needs 0.4 s"
    assert told(40)["bias"].value is not None
    assert told(30, 30)["bias_turn_on"].said == "needs two records of 0.4 s"
    assert told(40, 40)["bias_turn_on"].value is not None
    assert told(190)["start_up"].said == "needs 2 s"
    assert told(200)["start_up"].value is not None


def test_an_upper_limit_says_how_long_half_of_it_takes(tmp_path):
    bound, half = (
        hil.characterise(still(tmp_path / str(n), 1, n=n), out=tmp_path / "runs", report=False)["bias_instability"]
        for n in (6_000, 24_000)
    )
    assert bound.said == "upper limit (95 %); half of it needs about 4 min"
    assert shown(bound).startswith("< ")
    assert "to" not in shown(bound)
    assert half.value == pytest.approx(0.5 * bound.value, rel=0.3)
