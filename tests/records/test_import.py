"""`hil import`: every way a text record can be wrong is one line that names the place, and leaves nothing
behind.
"""

import gzip
from pathlib import Path

import numpy as np
import pytest

from hil.errors import InputError
from hil.importing.importer import import_record
from hil.importing.mapping import read_map
from hil.importing.uniformity import spacing
from hil.records.capture import read_capture

ROOT = Path(__file__).parents[2]
SILVERBOX_MAP = ROOT / "examples" / "silverbox.map.toml"
SILVERBOX = ROOT.parent / "shared" / "data" / "silverbox" / "SNLS80mV.csv.gz"

GOOD = "t_s,vx_V,vy_V,ux_mps2,uy_mps2\n0,1,2,3,4\n0.5,5,6,7,8\n1,9,10,11,12\n"
MAP = """\
hold = "zoh"
sampling_rate_Hz = 100.0
[columns]
vx_V = { column = "out", unit = "mV" }
ux_V = { column = "in", unit = "V" }
"""


@pytest.fixture
def bring(tmp_path):
    """Import a text (or bytes), with a map or without; gives the capture."""

    def bring(content, map_text=None, **options):
        source = tmp_path / "ride.csv"
        source.write_bytes(content if isinstance(content, bytes) else content.encode())
        if map_text is not None:
            options["map_file"] = tmp_path / "ride.map.toml"
            options["map_file"].write_text(map_text)
        return import_record(source, tmp_path / "out" / "ride.arrow", **options)

    return bring


def test_the_interchange_file(bring):
    capture = bring(GOOD)
    np.testing.assert_array_equal(capture.sense_V, [[1, 2], [5, 6], [9, 10]])
    np.testing.assert_array_equal(capture.drive, [[3, 4], [7, 8], [11, 12]])
    np.testing.assert_array_equal(capture.t_s, [0, 0.5, 1])
    assert (capture.tick_rate_Hz, capture.drive_unit, capture.hold, capture.uniform) == (
        2.0,
        "mps2",
        "zoh",
        True,
    )
    assert capture.complete


def test_columns_in_any_order_with_reference_and_temperature(bring):
    capture = bring("temp_C, ux_V, t_s, rate_rad_s, vx_V\n20,1,0,0.1,7\n21,2,1,0.2,8\n")
    assert capture.axes == 1
    np.testing.assert_array_equal(capture.rate_rad_s, [0.1, 0.2])
    np.testing.assert_array_equal(capture.temp_C, [20, 21])
    assert capture.drive_unit == "V"


@pytest.mark.parametrize(
    "content",
    [
        GOOD.replace("\n", ",\n"),  # a comma at each line's end
        GOOD.replace("\n", "\r\n"),
        "\ufeff" + GOOD,
        GOOD.replace("\n", "\n\n") + "\n\n",
        GOOD.rstrip("\n"),
        gzip.compress(GOOD.encode()),
    ],
    ids=["trailing comma", "crlf", "byte order mark", "blank lines", "no last newline", "gzip"],
)
def test_harmless_differences(bring, content):
    np.testing.assert_array_equal(bring(content).sense_V, [[1, 2], [5, 6], [9, 10]])


def test_hold_is_as_stated(bring):
    assert bring(GOOD, hold="foh").hold == "foh"


HEADER = "t_s,vx_V\n"


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", r"ride\.csv: empty"),
        ("\n\n  \n", r"ride\.csv: empty"),
        (HEADER, "no rows of numbers"),
        (HEADER + "0,1\n", "one row only"),
        ("t,vx_V\n0,1\n", r"ride\.csv:1: column 't' is not known; did you mean t_s\?|others need --map"),
        ("t_s,vx_mV\n0,1\n", r":1: column 'vx_mV' is not known; did you mean vx_V\?"),
        ("t_s,banana\n0,1\n", r":1: column 'banana' is not known; known are t_s, vx_V.* others need --map"),
        ("vx_V,ux_V\n0,1\n", ":1: no column t_s"),
        ("t_s,ux_V\n0,1\n", ":1: no column vx_V"),
        ("t_s,vx_V,vx_V\n0,1,1\n", ":1: column 'vx_V' appears twice"),
        ("t_s,vx_V,ux_V,ux_N\n0,1,1,1\n", ":1: two drives of one axis"),
        ("t_s,vx_V,vy_V,ux_V\n0,1,1,1\n", ":1: two axes but the drives are ux_V"),
        ("t_s,vx_V,vy_V,ux_V,uy_N\n0,1,1,1,1\n", ":1: two axes but the drives are ux_V, uy_N"),
        ("t_s,vx_V,uy_V\n0,1,1\n", ":1: column uy_V without vy_V"),
        (HEADER + "0,1\n1\n", r"ride\.csv:3: 1 cells where the first line has 2"),
        (HEADER + "0,1\n1,2,3\n", ":3: 3 cells where the first line has 2"),
        (HEADER + "0,1\n\n1,x1\n", r":4: column vx_V: 'x1' is not a number; mend or remove the row"),
        (HEADER + "0,1\n1,\n", ":3: column vx_V: the cell is empty"),
        (HEADER + "0,1\n1,nan\n", ":3: column vx_V: 'nan' is not finite"),
        (HEADER + "0,1\n-inf,2\n", ":3: column t_s: '-inf' is not finite"),
        (HEADER + "0,1\n1,1e999\n", ":3: column vx_V: '1e999' is not finite"),
        (HEADER + "0,1\n1,2\n1,3\n", r":4: column t_s: 1 s is the stamp of the row before as well; remove the row"),
        (HEADER + "0,1\n2,2\n1,3\n", r":4: column t_s: 1 s is not later than 2 s"),
        (
            HEADER + "0,1\n1,2\n2,3\n3.5,4\n4.5,5\n",
            r":5: column t_s: step of 1.5 s where 1 s is usual; give --nonuniform",
        ),
        (b"\x00\xff\xfe\x80" * 50, "not UTF-8 text"),
        (b"t_s,vx_V\n0,\xff\n", 'not UTF-8 text at line 2; set its encoding in a --map, as encoding = "cp1252"'),
        (gzip.compress(GOOD.encode() * 2000, mtime=0)[:-200], "damaged or cut gzip"),
        (b"\x1f\x8bnot really gzip", "damaged or cut gzip"),
        (HEADER + "0," + "9" * 200_000 + "\n", "not delimited text"),
    ],
    ids=lambda value: repr(value)[:40],  # a whole content is no name
)
def test_what_is_wrong_is_said_in_one_line_and_leaves_nothing(bring, tmp_path, content, complaint):
    with pytest.raises(InputError, match=complaint) as refusal:
        bring(content)
    assert "\n" not in str(refusal.value)
    assert "ride.csv" in str(refusal.value)
    assert not list((tmp_path / "out").glob("*")) if (tmp_path / "out").exists() else True


def test_a_refused_import_leaves_the_old_capture_as_it_was(bring, tmp_path):
    bring(GOOD)
    before = (tmp_path / "out" / "ride.arrow").read_bytes()
    with pytest.raises(InputError):
        bring(HEADER + "0,1\n1,nan\n")
    assert (tmp_path / "out" / "ride.arrow").read_bytes() == before
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["ride.arrow"]


def test_a_missing_file_and_a_folder(tmp_path):
    with pytest.raises(InputError, match=r"gone\.csv: cannot be read \(no such file or directory\)"):
        import_record(tmp_path / "gone.csv", tmp_path / "x.arrow")
    with pytest.raises(InputError, match=r"gone\.parquet: cannot be read \(no such file or directory\)"):
        import_record(tmp_path / "gone.parquet", tmp_path / "x.arrow")
    with pytest.raises(InputError, match="is a directory"):
        import_record(tmp_path, tmp_path / "x.arrow")


def test_a_time_beyond_all_dates_is_one_of_another_unit(bring):
    """Nanoseconds since 1970, as seconds: 4000 samples at 4e-06 Hz, without a word."""
    rows = [f"{1_764_000_000_000_000_000 + 250_000 * k},{0.1 * k:.3f}" for k in range(20)]
    with pytest.raises(InputError, match=r"t_s: begins at 1\.764e\+18 s, later than any date; say in the map .*ns"):
        bring(HEADER + "\n".join(rows) + "\n")


@pytest.mark.slow
def test_a_late_fault_in_a_long_file_is_found(bring):
    lines = [f"{tick * 1e-3:.3f},{tick}" for tick in range(40_000)]
    lines[33_333] = "33.333,oops"
    with pytest.raises(InputError, match=":33335: column vx_V: 'oops'"):
        bring(HEADER + "\n".join(lines))


def test_uneven_time_is_accepted_when_meant(bring):
    capture = bring(HEADER + "0,1\n1,2\n1.5,3\n4,4\n", nonuniform=True)
    assert not capture.uniform
    assert capture.tick_rate_Hz == pytest.approx(0.75)
    np.testing.assert_array_equal(capture.t_s, [0, 1, 1.5, 4])


@pytest.mark.parametrize("decimals", [5, 6, 9])
def test_rounded_stamps_give_the_rate_that_was_meant(decimals):
    stamps = np.round(np.arange(20_000) / 610.35, decimals)
    found = spacing(stamps)
    assert found.first_off_grid is None
    assert found.rate_Hz == 610.35


def test_a_rate_of_many_digits_is_kept():
    found = spacing(np.arange(131_072) / 610.3515625)
    assert found.rate_Hz == pytest.approx(610.3515625, rel=1e-12)


def test_a_map_scales_and_names(bring):
    extra = 'temp_C = { column = 3, unit = "K" }\n'
    extra += 'rate_rad_s = { column = "turn", unit = "deg/s", scale = 2, offset = 1 }\n'
    capture = bring("in,out,heat,turn,\n1,1000,300,90,\n2,2000,310,180,\n", MAP + extra)
    np.testing.assert_allclose(capture.sense_V[:, 0], [1, 2])
    np.testing.assert_allclose(capture.drive[:, 0], [1, 2])
    np.testing.assert_allclose(capture.temp_C, [26.85, 36.85])
    np.testing.assert_allclose(capture.rate_rad_s, np.radians([181, 361]))
    np.testing.assert_allclose(capture.t_s, [0, 0.01])
    assert capture.tick_rate_Hz == 100.0


def test_a_map_for_a_file_without_header(bring):
    text = 'hold = "foh"\nheader = false\ndelimiter = ";"\nskip_lines = 1\n[columns]\n'
    text += 't_s = { column = 2, unit = "ms" }\nvx_V = { column = 1, unit = "uV" }\n'
    capture = bring("a remark\n5;0\n6;250\n7;500\n", text)
    np.testing.assert_allclose(capture.sense_V[:, 0], [5e-6, 6e-6, 7e-6])
    assert (capture.tick_rate_Hz, capture.hold) == (4.0, "foh")
    assert not capture.has_drive


def test_unmapped_columns_may_hold_anything(bring):
    capture = bring("note,in,out\nstart,1,2\n,3,4\n", MAP)
    np.testing.assert_allclose(capture.drive[:, 0], [1, 3])


def test_rows_and_segments_count_from_the_first_row_of_the_file(bring):
    text = "rows = [2, 8]\n" + MAP + "[segments]\ntrain = [2, 5]\ntest = [5, 8]\n"
    capture = bring("in,out\n" + "".join(f"{n},{n}\n" for n in range(10)), text)
    np.testing.assert_array_equal(capture.drive[:, 0], [2, 3, 4, 5, 6, 7])
    assert capture.segments == {"train": (0, 3), "test": (3, 6)}
    np.testing.assert_array_equal(capture.segment("test").drive[:, 0], [5, 6, 7])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "missing"),
        ("hold = 3\n" + MAP[13:], "hold"),
        (MAP.replace('"zoh"', '"zho"'), "'zho' is not one of .*did you mean zoh"),
        (MAP.replace("sampling_rate_Hz", "sampling_rate"), "unknown key; did you mean sampling_rate_Hz"),
        (
            MAP.replace("sampling_rate_Hz = 100.0\n", ""),
            r"\[columns\] no column t_s; add it, or state sampling_rate_Hz",
        ),
        (MAP.replace("100.0", "-1"), "sampling_rate_Hz"),
        (MAP.replace("100.0", "inf"), "sampling_rate_Hz.*finite"),
        (MAP.replace("vx_V", "vz_V"), r"vz_V: unknown .*did you mean"),
        (MAP.replace(', unit = "mV"', ""), r"\[columns.vx_V\] unit: missing"),
        (MAP.replace('"mV"', '"mv"'), r"\[columns.vx_V\] unit: 'mv' is not known; known: V, mV, uV"),
        (MAP.replace('"mV"', '"furlong"'), r"unit: 'furlong' is not known; known: V, mV, uV"),
        (MAP.replace('column = "out", ', ""), r"\[columns.vx_V\] column: missing"),
        (MAP + 't_s = { column = "t", unit = "iso", add = [{ column = "u", unit = "S" }] }\n', "add: unit: 'S' is not"),
        (MAP + 'uy_V = { column = "in", unit = "V" }\n', "uy_V without vy_V"),
        ("rows = [5, 5]\n" + MAP, r"rows: \[5, 5\] is empty"),
        (
            "rows = [2, 6]\n" + MAP + "[segments]\na = [1, 3]\n",
            r"\[segments\] a: \[1, 3\] leaves rows \[2, 6\]",
        ),
        ("header = false\n" + MAP, "the file has no header; give a position"),
        ("hold = ", "not TOML"),
    ],
)
def test_a_wrong_map_is_told_in_one_line(bring, text, complaint):
    with pytest.raises(InputError, match=complaint) as refusal:
        bring("in,out\n1,2\n3,4\n", text)
    assert "ride.map.toml" in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("content", "text", "complaint"),
    [
        ("in,aus\n1,2\n3,4\n", MAP, r"ride\.csv: no column 'out' for vx_V; the file has: in, aus"),
        ("in,out\n1,2\n3,4\n", "rows = [0, 3]\n" + MAP, "ends at data row 2, before the map's rows end"),
        ("in,out\n1,2\n3,4\n", "rows = [7, 9]\n" + MAP, r"no rows of numbers in rows \[7, 9\)"),
        ("in,out\n1,2\n3,4\n", MAP + "[segments]\nall = [0, 3]\n", "ends at data row 2, before segment all"),
        ("in,out\n1,2\n3,zz\n", MAP, r":3: column out \(vx_V\): 'zz' is not a number"),
    ],
)
def test_a_file_that_does_not_fit_its_map(bring, content, text, complaint):
    with pytest.raises(InputError, match=complaint):
        bring(content, text)


@pytest.mark.long
def test_the_silverbox_map_reads_a_file_of_that_shape(tmp_path):
    values = np.arange(127_400)
    text = '"V1","V2",\n' + "".join(f"{n % 97 * 1e-3:.7g},{n % 89 * 1e-3:.7g},\n" for n in values) + "\n"
    source = tmp_path / "SNLS80mV.csv.gz"
    source.write_bytes(gzip.compress(text.encode(), 1))
    capture = import_record(source, tmp_path / "silverbox.arrow", map_file=SILVERBOX_MAP)
    np.testing.assert_allclose(capture.drive[:, 0], values % 97 * 1e-3)
    np.testing.assert_allclose(capture.sense_V[:, 0], values % 89 * 1e-3)
    assert (capture.axes, capture.drive_unit, capture.hold) == (1, "V", "bandlimited")
    assert capture.segments["train"] == (40650, 105712)


@pytest.mark.long
@pytest.mark.skipif(not SILVERBOX.exists(), reason="the measured record is not beside the checkout")
def test_the_measured_silverbox_record(tmp_path):
    capture = import_record(SILVERBOX, tmp_path / "silverbox.arrow", map_file=SILVERBOX_MAP)
    assert len(capture) == 131_072
    assert capture.drive[0, 0] == 0.0057756
    assert capture.sense_V[0, 0] == 0.0093978
    assert capture.tick_rate_Hz == 610.3515625
    assert read_map(SILVERBOX_MAP).segments.keys() == {
        "train",
        "multisine",
        "arrow",
        "arrow_no_extrapolation",
    }
    assert read_capture(tmp_path / "silverbox.arrow").complete
