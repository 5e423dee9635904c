"""Records that are neither time series in a plain CSV: MATLAB vectors, tables of steady states, chosen rows."""

import numpy as np
import pytest
from scipy.io import savemat

from hil.errors import InputError
from hil.exporting.exporter import export
from hil.importing.importer import import_record

VECTORS = """\
hold = "zoh"
[columns]
t_s = { column = "t", unit = "s" }
vx_V = { column = "q", unit = "mV" }
ux_N = { column = "force", unit = "N", scale = 2.0 }
"""
STEADY = """\
hold = "zoh"
steady = true
where = { sensor = "B" }
[columns]
rate_rad_s = { column = "dps", unit = "deg/s" }
vx_V = { column = "out", unit = "V" }
[segments]
train = [0, 2]
test = [2, 3]
"""
TABLE = "sensor,dps,out\nA,1,9\nB,180,1\nB,90,0.5\nA,2,8\nB,-90,-0.5\n"


@pytest.fixture
def bring(tmp_path):
    def bring(source, map_text):
        (tmp_path / "m.map.toml").write_text(map_text)
        return import_record(source, tmp_path / "record.arrow", map_file=tmp_path / "m.map.toml")

    return bring


@pytest.fixture
def vectors(tmp_path):
    def write(**changed):
        fields = {"t": np.arange(5) / 100.0, "q": np.arange(5.0)[:, None], "force": np.arange(5) * 3} | changed
        savemat(tmp_path / "record.mat", fields)
        return tmp_path / "record.mat"

    return write


def test_matlab_vectors_become_columns(bring, vectors):
    capture = bring(vectors(), VECTORS)
    np.testing.assert_allclose(capture.sense_V[:, 0], np.arange(5) * 1e-3)
    np.testing.assert_allclose(capture.drive[:, 0], np.arange(5) * 6.0)
    assert (capture.tick_rate_Hz, capture.drive_unit) == (100.0, "N")


def test_a_matlab_file_needs_a_map(vectors, tmp_path):
    with pytest.raises(InputError, match=r"record.mat: a MATLAB file; give a --map"):
        import_record(vectors(), tmp_path / "record.arrow")


def test_rows_of_a_matlab_file(bring, vectors):
    capture = bring(vectors(), "rows = [1, 4]\n" + VECTORS)
    np.testing.assert_allclose(capture.sense_V[:, 0], [1e-3, 2e-3, 3e-3])


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"q": np.zeros(4)}, "vectors of unequal length (t 5, q 4, force 5)"),
        ({"q": np.zeros((5, 2))}, "variable q is 5 by 2; give one of its columns, as q(:,1)"),
        ({"q": "text"}, "variable q is text; give a variable of numbers"),
        ({"q": np.array([0, 1, np.nan, 3, 4])}, "variable q: entry 3: nan is no measurement"),
    ],
)
def test_what_is_wrong_with_a_vector_is_told(bring, vectors, changed, told):
    with pytest.raises(InputError) as caught:
        bring(vectors(**changed), VECTORS)
    assert told in str(caught.value)


def test_absent_variables_and_files_that_are_not_matlab(bring, vectors, tmp_path):
    with pytest.raises(InputError, match=r"record.mat: no variable 'nothing'; the file has: t, q, force"):
        bring(vectors(), VECTORS.replace('"q"', '"nothing"'))
    with pytest.raises(InputError, match=r"none.mat: cannot be read"):
        bring(tmp_path / "none.mat", VECTORS)
    (tmp_path / "other.mat").write_bytes(b"no MATLAB at all, but long enough to have a header" * 9)
    with pytest.raises(InputError, match=r"other.mat: not a MATLAB file, or damaged"):
        bring(tmp_path / "other.mat", VECTORS)
    whole = vectors().read_bytes()
    (tmp_path / "cut.mat").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"cut.mat: "):
        bring(tmp_path / "cut.mat", VECTORS)


def test_steady_states_of_one_sensor(bring, tmp_path):
    (tmp_path / "table.csv").write_text(TABLE)
    capture = bring(tmp_path / "table.csv", STEADY)
    assert capture.steady
    np.testing.assert_allclose(capture.rate_rad_s, np.pi * np.array([1.0, 0.5, -0.5]))
    np.testing.assert_allclose(capture.sense_V[:, 0], [1.0, 0.5, -0.5])
    assert capture.segments == {"train": (0, 2), "test": (2, 3)}
    export(tmp_path / "record.arrow", tmp_path / "back.csv", "csv")
    assert len((tmp_path / "back.csv").read_text().splitlines()) == 4


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('{ sensor = "B" }', '{ sensor = "C" }', "no rows of numbers where sensor reads 'C'"),
        ('{ sensor = "B" }', '{ maker = "B" }', "no column 'maker' for `where`; the file has: sensor, dps, out"),
        ("steady = true", "steady = true\nsampling_rate_Hz = 1.0", "steady: steady states have no time"),
        ("steady = true\n", "", "no column t_s"),
        ("steady = true", "steady = true\nheader = false", "where: the file has no header"),
        ("[2, 3]", "[2, 4]", "ends at data row 3, before segment test (4)"),
    ],
)
def test_mistakes_with_steady_states(bring, tmp_path, old, new, told):
    (tmp_path / "table.csv").write_text(TABLE)
    with pytest.raises(InputError) as caught:
        bring(tmp_path / "table.csv", STEADY.replace(old, new))
    assert told in str(caught.value)
