"""`hil export`: SI values that other programs read, and that read back."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from hil.errors import InputError
from hil.interchange.exporter import export_record
from hil.interchange.importer import import_record
from hil.records.capture import read_capture


@pytest.fixture
def capture_path(make_run):
    folder, _ = make_run(seconds=0.5)
    return folder / "capture.arrow"


def test_a_csv_reads_back_to_the_last_digit(capture_path, tmp_path):
    target = tmp_path / "ride.csv"
    assert export_record(capture_path, target, "csv") == 2000
    assert target.read_text().startswith("t_s,vx_V,vy_V,ux_mps2,uy_mps2\n")
    original, again = read_capture(capture_path), import_record(target, tmp_path / "again.arrow")
    np.testing.assert_array_equal(again.sense_V, original.sense_V)
    np.testing.assert_array_equal(again.drive, original.drive)
    np.testing.assert_array_equal(again.t_s, original.t_s)
    assert again.tick_rate_Hz == original.tick_rate_Hz


def test_an_imported_record_keeps_its_extra_channels(tmp_path):
    text = "t_s,vx_V,rate_rad_s,temp_C\n0,1.5,0.25,20\n0.1,2.5,0.5,21\n"
    (tmp_path / "a.csv").write_text(text)
    import_record(tmp_path / "a.csv", tmp_path / "a.arrow")
    export_record(tmp_path / "a.arrow", tmp_path / "b.csv", "csv")
    assert (tmp_path / "b.csv").read_text() == text


def test_parquet_has_ticks_flags_and_what_the_numbers_mean(capture_path, tmp_path):
    target = tmp_path / "ride.parquet"
    export_record(capture_path, target, "parquet")
    table, capture = pq.read_table(target), read_capture(capture_path)
    assert table.column_names == ["tick", "t_s", "vx_V", "vy_V", "ux_mps2", "uy_mps2", "flags"]
    np.testing.assert_array_equal(table["vy_V"].to_numpy(), capture.sense_V[:, 1])
    np.testing.assert_array_equal(table["flags"].to_numpy(), capture.flags)
    about = json.loads(table.schema.metadata[b"gyrohil"])
    assert (about["hold"], about["tick_rate_Hz"], about["complete"]) == ("zoh", 4000.0, True)


def test_refusals_leave_nothing(capture_path, tmp_path):
    with pytest.raises(InputError, match="known are csv, parquet"):
        export_record(capture_path, tmp_path / "ride.mat", "mat")
    with pytest.raises(InputError, match="holds 'estimates'"):
        export_record(capture_path.parent / "estimates.arrow", tmp_path / "ride.csv", "csv")
    assert not (tmp_path / "ride.mat").exists()
    assert not (tmp_path / "ride.csv").exists()
