"""Parquet comes in as `hil export` lets it out, and is refused in one line where it cannot."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from hil.errors import InputError
from hil.exporting.exporter import export
from hil.importing.importer import import_record
from hil.records.capture import read_capture

T_S = np.arange(400) / 500.0
COLUMNS = {"t_s": T_S, "vx_V": np.sin(40.0 * T_S), "ux_N": np.cos(3.0 * T_S)}


def written(path: Path, columns: dict[str, object], about: bytes = b"{}") -> Path:
    table = pa.table(columns).replace_schema_metadata({b"gyrohil": about})
    pq.write_table(table, path)
    return path


def test_there_and_back_it_is_the_same(tmp_path: Path) -> None:
    source = written(tmp_path / "a.parquet", COLUMNS, json.dumps({"hold": "foh"}).encode())
    import_record(source, tmp_path / "a.arrow")
    export(tmp_path / "a.arrow", tmp_path / "b.parquet", "parquet", ())
    import_record(tmp_path / "b.parquet", tmp_path / "b.arrow")
    for name in ("a", "b"):
        capture = read_capture(tmp_path / f"{name}.arrow")
        assert (capture.hold, capture.tick_rate_Hz, capture.axes) == ("foh", pytest.approx(500.0), 1)
        np.testing.assert_array_equal(capture.sense_V[:, 0], COLUMNS["vx_V"])
        np.testing.assert_array_equal(capture.drive[:, 0], COLUMNS["ux_N"])


@pytest.mark.parametrize("about", [b"{}", b"[", b'{"hold": "sideways"}', b"7"])
def test_what_says_nothing_of_the_hold_is_held(tmp_path: Path, about: bytes) -> None:
    import_record(written(tmp_path / "a.parquet", COLUMNS, about), tmp_path / "a.arrow")
    assert read_capture(tmp_path / "a.arrow").hold == "zoh"


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({**COLUMNS, "vx_V": ["a"] * 400}, "column vx_V: string is no number"),
        ({**COLUMNS, "vx_V": np.where(T_S > 0.5, np.nan, 0.0)}, "column vx_V: row 251"),
        ({**COLUMNS, "vx_V": pa.array([None] * 400, pa.float64())}, "column vx_V: row 0"),
        ({**COLUMNS, "vx_v": T_S}, "column 'vx_v' is not known; did you mean vx_V"),
        ({"t_s": T_S, "ux_N": T_S}, "no column vx_V"),
        ({**COLUMNS, "t_s": T_S[::-1]}, "t_s"),
    ],
)
def test_what_is_no_record_is_refused(tmp_path: Path, columns: dict[str, object], said: str) -> None:
    source = written(tmp_path / "a.parquet", columns)
    with pytest.raises(InputError, match=said):
        import_record(source, tmp_path / "a.arrow")
    assert not (tmp_path / "a.arrow").exists()


def test_a_file_that_is_cut_is_refused(tmp_path: Path) -> None:
    source = written(tmp_path / "a.parquet", COLUMNS)
    source.write_bytes(source.read_bytes()[:-40])
    with pytest.raises(InputError, match="no Parquet file that can be read"):
        import_record(source, tmp_path / "a.arrow")
