"""Records that imports got wrong once, and records as instruments write them: each beside an independent reader."""

import csv
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat
from scipy.optimize import least_squares

import hil
from hil.errors import InputError
from hil.importing.importer import Imported, import_file
from hil.importing.request import ImportRequest
from hil.records.capture import Capture

CASES = Path(__file__).parents[3] / "shared" / "cases"
IMPORT, INSTRUMENTS = CASES / "import", CASES / "instruments"
pytestmark = pytest.mark.skipif(not CASES.exists(), reason="the cases are not beside the checkout")


@pytest.fixture
def bring(tmp_path):
    """Import a file with a map's text, or that of a file with lines in place of others; gives what was imported."""

    def bring(
        source: Path, mapping: str | Path | None = None, /, *, nonuniform: bool = False, **changed: str
    ) -> Imported:
        made = None
        if mapping is not None:
            text = mapping.read_text(encoding="utf-8") if isinstance(mapping, Path) else mapping
            keys = "".join(f"{key} = {value}\n" for key, value in changed.items())
            kept = "".join(f"{line}\n" for line in text.splitlines() if line.split("=")[0].strip() not in changed)
            made = tmp_path / "made.map.toml"
            made.write_text(keys + kept, encoding="utf-8")
        return import_file(ImportRequest(source, tmp_path / "made.arrow", map_file=made, nonuniform=nonuniform))

    return bring


def rows_of(path: Path, delimiter: str = ",") -> list[list[str]]:
    """By the csv module, a line a row."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file, delimiter=delimiter, quoting=csv.QUOTE_NONE))


def sensed(capture: Capture) -> np.ndarray:
    return capture.sense_V[:, 0]


def test_two_columns_of_one_name_are_told_apart_by_position(bring):
    source, mapping = IMPORT / "two_of_one_name.csv", IMPORT / "duplicate-names-made.map.toml"
    with pytest.raises(InputError, match=r"2 columns are called 'Voltage \(V\)', at positions 2 and 3; .*column = 2"):
        bring(source, mapping)
    text = mapping.read_text(encoding="utf-8")
    text = text.replace('"Voltage (V)"', "2", 1).replace('"Voltage (V)"', "3", 1)
    capture = bring(source, text).capture
    table = np.array(rows_of(source)[1:], dtype=float)
    np.testing.assert_array_equal(sensed(capture), table[:, 1])
    np.testing.assert_array_equal(capture.drive[:, 0], table[:, 2])


@pytest.mark.parametrize("name", ["remark.csv", "remark_open.csv"])
@pytest.mark.parametrize("mapping", ["quotes-time.map.toml", "quotes-rate.map.toml"])
def test_a_stray_quote_loses_no_row(bring, name, mapping):
    with pytest.raises(InputError, match=rf"{name}:502: a quote .* set quote = \"\""):
        bring(IMPORT / name, IMPORT / mapping)
    imported = bring(IMPORT / name, IMPORT / mapping, quote='""')
    rows = rows_of(IMPORT / name)[1:]
    assert imported.of_rows == len(imported.capture) == len(rows) == 2000
    np.testing.assert_array_equal(sensed(imported.capture), [float(row[1]) for row in rows])


def test_rows_of_one_sensor_of_a_matlab_file(bring):
    there = loadmat(IMPORT / "two_same_rate.mat", simplify_cells=True)
    capture = bring(IMPORT / "two_same_rate.mat", IMPORT / "matlab-w.map.toml").capture
    np.testing.assert_array_equal(sensed(capture), there["v"][there["sensor"] == 2])
    for key, value in {"skip_lines": "1", "delimiter": '";"'}.items():
        with pytest.raises(InputError, match=f"{key}: acts on text only"):
            bring(IMPORT / "two_same_rate.mat", IMPORT / "matlab-w.map.toml", **{key: value})


def test_a_gap_is_counted(bring):
    with pytest.raises(InputError, match=r"gap\.csv:\d+: column t_s: .*20 samples are missing, in 1 gap"):
        bring(IMPORT / "gap.csv")
    capture = bring(IMPORT / "gap.csv", nonuniform=True).capture
    table = np.array(rows_of(IMPORT / "gap.csv")[1:], dtype=float)
    assert (capture.lost, capture.gaps, capture.tick_rate_Hz) == (20, 1, 1000.0)
    np.testing.assert_array_equal(capture.tick, np.round((table[:, 0] - table[0, 0]) * 1000))


def test_what_an_instrument_writes_over_range_is_no_measurement(bring):
    with pytest.raises(InputError, match=r"scpi\.csv:\d+: column vx_V: 9\.9e\+37 stands for no measurement") as told:
        bring(IMPORT / "scpi.csv")
    line = int(str(told.value).split("scpi.csv:")[1].split(":")[0])
    rows = rows_of(IMPORT / "scpi.csv")
    assert float(rows[line - 1][1]) == 9.9e37
    capture = bring(IMPORT / "scpi.csv", 'hold = "zoh"\n', missing="[9.9e37]").capture
    good = [row for row in rows[1:] if float(row[1]) != 9.9e37]
    assert capture.lost == len(rows) - 1 - len(good) > 0
    np.testing.assert_array_equal(sensed(capture), [float(row[1]) for row in good])


def test_nanoseconds_since_1970_are_even(bring):
    capture = bring(IMPORT / "epoch_ns_100k.csv", IMPORT / "time-text-ns.map.toml").capture
    stamps = [int(row[0]) for row in rows_of(IMPORT / "epoch_ns_100k.csv")[1:]]
    assert (capture.uniform, capture.tick_rate_Hz) == (True, 1e5)
    np.testing.assert_allclose(capture.t_s, [(stamp - stamps[0]) * 1e-9 for stamp in stamps], rtol=0, atol=1e-15)


def test_columns_that_nobody_asked_for_may_hold_anything(bring):
    imported = bring(IMPORT / "extra_int.parquet")
    frame = pq.read_table(IMPORT / "extra_int.parquet").to_pandas()
    assert imported.left_out == ("seq",)
    np.testing.assert_array_equal(sensed(imported.capture), frame["vx_V"])
    np.testing.assert_array_equal(imported.capture.drive[:, 0], frame["ux_N"])


def test_underscores_are_no_digits(bring):
    with pytest.raises(InputError, match=r"under\.csv:2: column v \(vx_V\): '1_000' is not a number"):
        bring(IMPORT / "under.csv", IMPORT / "quotes-time.map.toml")


def test_a_point_between_thousands_takes_a_key(bring):
    source, mapping = IMPORT / "thousands.csv", IMPORT / "quotes-time.map.toml"
    with pytest.raises(
        InputError,
        match=r"6: column v \(vx_V\): '-1\.319' may be -1319, .*thousands = \"\.\" of this column .* decimal = \"\.\"",
    ):
        bring(source, mapping, delimiter='";"')
    text = mapping.read_text(encoding="utf-8")
    rows = rows_of(source, ";")[1:]
    capture = bring(source, text, delimiter='";"', decimal='"."').capture
    np.testing.assert_array_equal(sensed(capture), [float(row[1]) for row in rows])
    capture = bring(source, text.replace('"v"', '"v", thousands = "."'), delimiter='";"').capture
    expected = [int(row[1].replace(".", "")) for row in rows]
    np.testing.assert_array_equal(sensed(capture), expected)
    assert sensed(capture)[4] == -1319.0


@pytest.mark.parametrize(("unit", "column"), [("dBuV", 1), ("dBV", 2)])
def test_a_level_keeps_its_unit_or_becomes_volts(bring, unit, column):
    source = INSTRUMENTS / "1_level_dBuV.csv"
    levels = np.array([float(row[column]) for row in rows_of(source, ";")[1:]])
    capture = bring(source, INSTRUMENTS / f"1_{unit}.map.toml").capture
    assert capture.sense_unit == unit
    np.testing.assert_array_equal(sensed(capture), levels)
    text = (INSTRUMENTS / f"1_{unit}.map.toml").read_text(encoding="utf-8").replace("vx =", "vx_V =")
    capture = bring(source, text).capture
    reference = {"dBuV": 1e-6, "dBV": 1.0}[unit]
    np.testing.assert_allclose(20.0 * np.log10(sensed(capture) / reference), levels, atol=1e-9)


def test_a_comment_column_that_rows_leave_empty(bring):
    source = INSTRUMENTS / "2_lvm_comment_column.lvm"
    capture = bring(source, INSTRUMENTS / "2.map.toml").capture
    rows = rows_of(source, "\t")[11:]
    np.testing.assert_array_equal(sensed(capture), [float(row[1]) for row in rows])
    assert (len(capture), capture.tick_rate_Hz) == (300, 1000.0)


def test_a_row_of_units_and_a_cell_too_many(bring):
    source = INSTRUMENTS / "3_rigol_sequence.csv"
    with pytest.raises(InputError, match="set units_row = true; its columns are then X, CH1, CH2"):
        bring(source, INSTRUMENTS / "3_header.map.toml")
    capture = bring(source, INSTRUMENTS / "3_header.map.toml", units_row="true").capture
    rows = rows_of(source)[2:]
    np.testing.assert_array_equal(sensed(capture), [float(row[1]) for row in rows])
    np.testing.assert_allclose(capture.t_s, [-0.03 + 1e-3 * int(row[0]) for row in rows], atol=1e-12)


def test_runs_of_blanks(bring):
    capture = bring(INSTRUMENTS / "4_fixed_width.txt", INSTRUMENTS / "4.map.toml").capture
    frame = pd.read_fwf(INSTRUMENTS / "4_fixed_width.txt")
    np.testing.assert_array_equal(sensed(capture), frame["vx"])


@pytest.mark.parametrize(
    "keys",
    [
        'skip_lines = 2\n[columns]\nt_s = { column = "% Time (s)"',
        'comment = "%"\nheader = false\n[columns]\nt_s = { column = 1',
    ],
)  # fmt: skip
def test_a_preamble_of_comments(bring, keys):
    source = INSTRUMENTS / "5_comment_preamble_percent.csv"
    with pytest.raises(InputError, match="give a --map with skip_lines = 2; its columns are then % Time"):
        bring(source)
    capture = bring(source, f'hold = "zoh"\n{keys}, unit = "s" }}\nvx_V = {{ column = 2, unit = "V" }}\n').capture
    np.testing.assert_array_equal(sensed(capture), np.loadtxt(source, comments="%", delimiter=",")[:, 1])


@pytest.mark.parametrize(
    ("name", "mapping", "more", "rate_Hz"),
    [
        ("6_ros2_two_columns.csv", "6", ('"header.stamp.nanosec"', "ns", '"header.stamp.sec"', "s"), 200.0),
        ("6b_gps_week_tow.csv", "6b", ('"GPSSecond"', "s", '"GPSWeek"', "week"), 100.0),
    ],
)
def test_time_in_two_columns(bring, name, mapping, more, rate_Hz):
    text = (INSTRUMENTS / f"{mapping}.map.toml").read_text(encoding="utf-8")
    column, unit, other, its = more
    plain = f'column = {column}, unit = "{unit}"'
    assert plain in text
    text = text.replace(plain, f'{plain}, add = [{{ column = {other}, unit = "{its}" }}]')
    capture = bring(INSTRUMENTS / name, text).capture
    frame = pd.read_csv(INSTRUMENTS / name)
    np.testing.assert_array_equal(sensed(capture), frame.iloc[:, 2])
    assert (capture.uniform, capture.lost, capture.tick_rate_Hz) == (True, 0, rate_Hz)
    if mapping == "6":
        whole = [int(seconds) * 10**9 + int(nano) for seconds, nano in frame.iloc[:, :2].to_numpy()]
        elapsed = [(one - whole[0]) * 1e-9 for one in whole]
        np.testing.assert_allclose(capture.t_s - capture.t_s[0], elapsed, atol=1e-12)


def test_a_struct_with_time(bring):
    source = INSTRUMENTS / "7_simulink_struct_with_time.mat"
    with pytest.raises(InputError, match=r"is 300 by 2; give one of its columns, as ScopeData\.signals\.values\(:,1\)"):
        bring(source, INSTRUMENTS / "7.map.toml")
    text = (INSTRUMENTS / "7.map.toml").read_text(encoding="utf-8")
    for column in (1, 2):
        capture = bring(source, text.replace(".values", f".values(:,{column})")).capture
        there = loadmat(source, simplify_cells=True)["ScopeData"]
        np.testing.assert_array_equal(sensed(capture), there["signals"]["values"][:, column - 1])
        np.testing.assert_array_equal(capture.t_s, there["time"])


def test_stamps_of_a_millisecond_at_400_Hz(bring):
    source, mapping = INSTRUMENTS / "9_millis_400Hz.csv", INSTRUMENTS / "9.map.toml"
    with pytest.raises(InputError, match=r"rounded to 0\.001 s, .* set sampling_rate_Hz = 400 in the map") as told:
        bring(source, mapping)
    assert "nonuniform" not in str(told.value)
    capture = bring(source, mapping, sampling_rate_Hz="400").capture
    assert (capture.uniform, capture.lost, capture.tick_rate_Hz, capture.sense_unit) == (True, 0, 400.0, "LSB")
    np.testing.assert_allclose(capture.t_s, 1.0 + np.arange(len(capture)) / 400.0)


@pytest.mark.slow
@pytest.mark.parametrize("given", [{"sampling_rate_Hz": "400"}, {"nonuniform": True}])
def test_intervals_of_millisecond_stamps_hold_least_squares(bring, tmp_path, given):
    """The decay in closed form, fitted with SciPy at 400 Hz, which the record was made with."""
    capture = bring(INSTRUMENTS / "9_millis_400Hz.csv", INSTRUMENTS / "9.map.toml", **given).capture
    levels = sensed(capture)
    elapsed = np.arange(levels.size) / 400.0

    def missed(known):
        stiffness, damping, cosine, sine, offset = known
        phase = np.sqrt(stiffness - 0.25 * damping**2) * elapsed
        return np.exp(-0.5 * damping * elapsed) * (cosine * np.cos(phase) + sine * np.sin(phase)) + offset - levels

    found = least_squares(missed, [5970.0, 1.3, 13000.0, 0.0, 0.0], x_scale=[1.0, 0.01, 10.0, 10.0, 1.0])
    assert np.sqrt(2.0 * found.cost / levels.size) == pytest.approx(17.0, rel=0.05)  # the noise declared
    np.testing.assert_allclose(found.x[:2], [5972.672, 1.28774], rtol=1e-6)
    run = hil.replay(tmp_path / "made.arrow", INSTRUMENTS / "9.bench.toml", out=tmp_path / "runs")
    assert run.verdict == "good"
    for name, truth in zip(("kxx", "dxx"), found.x[:2], strict=True):
        estimate = run.result.parameters[name]
        assert estimate.ci95[0] < truth < estimate.ci95[1]


def test_a_rate_in_its_own_unit(bring):
    capture = bring(INSTRUMENTS / "10_gyro_mdps.csv", INSTRUMENTS / "10.map.toml").capture
    frame = pd.read_csv(INSTRUMENTS / "10_gyro_mdps.csv")
    assert capture.sense_unit == "mdps"
    np.testing.assert_array_equal(sensed(capture), frame["Gyro(mdps)"])
    np.testing.assert_allclose(capture.rate_rad_s, np.radians(frame["Table(dps)"]))


@pytest.mark.parametrize("name", ["good.csv", "deg_converted_twice.csv", "fs10.0.csv"])
def test_plain_files(bring, name):
    capture = bring(IMPORT / name).capture
    table = np.array(rows_of(IMPORT / name)[1:], dtype=float)
    np.testing.assert_array_equal(np.column_stack([capture.t_s, sensed(capture), capture.rate_rad_s]), table)
