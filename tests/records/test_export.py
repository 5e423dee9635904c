"""`hil export`: SI values that other programs read, and that read back (docs/reference/export.md)."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from scipy.io import loadmat

import hil
from hil.errors import InputError
from hil.exporting.exported import Exported
from hil.exporting.exporter import _WRITERS, FORMATS, export, write_mat, write_mcap
from hil.importing.importer import import_record
from hil.records.capture import read_capture
from hil.records.estimates import Estimates, Innovation

EVERY = ("capture", "estimates", "innovation")


@pytest.fixture
def folder(make_run):
    return make_run(seconds=0.5)[0]


def messages(path: Path) -> dict[str, tuple[np.ndarray, list[dict]]]:
    """Times in ns and messages of each topic, as the format's own reader gives them."""
    found: dict[str, tuple[list[int], list[dict]]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            assert message.log_time == message.publish_time
            times, rows = found.setdefault(channel.topic, ([], []))
            times.append(message.log_time)
            rows.append(json.loads(message.data))
    return {topic: (np.array(times), rows) for topic, (times, rows) in found.items()}


@pytest.mark.moderate
def test_a_csv_reads_back_to_the_last_digit(folder, tmp_path):
    target = tmp_path / "ride.csv"
    assert export(folder / "capture.arrow", target, "csv").rows == {"capture": 2000}
    assert target.read_text().startswith("t_s,vx_V,vy_V,ux_mps2,uy_mps2\n")
    original, again = read_capture(folder / "capture.arrow"), import_record(target, tmp_path / "again.arrow")
    np.testing.assert_array_equal(again.sense_V, original.sense_V)
    np.testing.assert_array_equal(again.drive, original.drive)
    np.testing.assert_array_equal(again.t_s, original.t_s)
    assert again.tick_rate_Hz == original.tick_rate_Hz


def test_an_imported_record_keeps_its_extra_channels(tmp_path):
    text = "t_s,vx_V,rate_rad_s,temp_C\n0,1.5,0.25,20\n0.1,2.5,0.5,21\n"
    (tmp_path / "a.csv").write_text(text)
    import_record(tmp_path / "a.csv", tmp_path / "a.arrow")
    export(tmp_path / "a.arrow", tmp_path / "b.csv", "csv")
    assert (tmp_path / "b.csv").read_text() == text


@pytest.mark.moderate
def test_parquet_has_ticks_flags_and_what_the_numbers_mean(folder, tmp_path):
    target = tmp_path / "ride.parquet"
    export(folder, target, "parquet")
    table, capture = pq.read_table(target), read_capture(folder / "capture.arrow")
    assert table.column_names == ["tick", "t_s", "vx_V", "vy_V", "ux_mps2", "uy_mps2", "flags"]
    np.testing.assert_array_equal(table["vy_V"].to_numpy(), capture.sense_V[:, 1])
    np.testing.assert_array_equal(table["flags"].to_numpy(), capture.flags)
    about = json.loads(table.schema.metadata[b"gyrohil"])
    assert (about["hold"], about["tick_rate_Hz"], about["complete"]) == ("zoh", 4000.0, True)
    assert [table.schema.field(name).metadata[b"unit"] for name in ("t_s", "ux_mps2")] == [b"s", "m/s²".encode()]


@pytest.mark.moderate
@pytest.mark.parametrize("to", ["csv", "parquet"])
@pytest.mark.parametrize(
    ("what", "columns"),
    [
        ("angle", ["t_s", "angle_rad", "angle_u_rad", "valid"]),
        ("rate", ["t_s", "rate_rad_s", "sd_rate_rad_s"]),
        ("innovation", ["t_s", "nu_x_V", "nu_y_V", "s_x_V", "s_y_V"]),
    ],
)
def test_what_was_estimated_with_its_uncertainty(folder, tmp_path, to, what, columns):
    target = tmp_path / f"{what}.{to}"
    rows = export(folder, target, to, (what,)).rows
    if to == "csv":
        assert target.read_text().partition("\n")[0] == ",".join(columns)
        values = np.loadtxt(target, delimiter=",", skiprows=1)
    else:
        table = pq.read_table(target)
        assert table.column_names == ["tick", *columns]
        values = np.column_stack([table[name].to_numpy() for name in columns])
    read = {"innovation": Innovation.read}.get(what, Estimates.read)
    kept = read(folder / ("innovation.arrow" if what == "innovation" else "estimates.arrow"))
    there = kept.columns
    assert rows == {what: len(kept)}
    np.testing.assert_array_equal(values[:, 0], kept.t_s)
    for index, name in enumerate(columns[1:], start=1):
        np.testing.assert_array_equal(values[:, index].astype(there[name].dtype), there[name], err_msg=name)


@pytest.mark.moderate
def test_a_mat_file_has_a_struct_for_each_table(folder, tmp_path):
    target = tmp_path / "ride.mat"
    rows = export(folder, target, "mat").rows
    read = loadmat(target, simplify_cells=True)
    assert tuple(rows) == EVERY
    estimates, capture = Estimates.read(folder / "estimates.arrow"), read_capture(folder / "capture.arrow")
    np.testing.assert_array_equal(read["capture"]["vx_V"], capture.sense_V[:, 0])
    np.testing.assert_array_equal(read["capture"]["uy_mps2"], capture.drive[:, 1])
    for name in ("kxx_per_s2", "sd_kxx_per_s2", "angle_rad", "angle_u_rad"):
        np.testing.assert_array_equal(read["estimates"][name], estimates[name])
    assert read["estimates"]["units"]["kxx_per_s2"] == "1/s²"
    assert json.loads(read["capture"]["about"])["hold"] == "zoh"
    as_in_matlab = loadmat(target)["capture"][0, 0]["vx_V"]
    assert as_in_matlab.shape == (2000, 1)


@pytest.mark.moderate
def test_an_mcap_file_has_a_topic_for_each_table_in_the_order_of_time(folder, tmp_path):
    target = tmp_path / "ride.mcap"
    rows = export(folder, target, "mcap").rows
    found = messages(target)
    assert {topic.removeprefix("/"): len(times) for topic, (times, _) in found.items()} == rows
    estimates, capture = Estimates.read(folder / "estimates.arrow"), read_capture(folder / "capture.arrow")
    times, told = found["/capture"]
    np.testing.assert_allclose(1e-9 * times, capture.t_s, atol=1e-9)
    np.testing.assert_array_equal([row["vy_V"] for row in told], capture.sense_V[:, 1])
    np.testing.assert_array_equal([row["tick"] for row in told], capture.tick)
    times, told = found["/estimates"]
    np.testing.assert_allclose(1e-9 * times, estimates.t_s, atol=1e-9)
    for name in ("angle_rad", "angle_u_rad", "sd_kxx_per_s2"):
        np.testing.assert_array_equal([row[name] for row in told], estimates[name])
    with target.open("rb") as file:
        reader = make_reader(file)
        order = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
        assert order == sorted(order)
        summary = reader.get_summary()
        assert {channel.schema_id for channel in summary.channels.values()} <= set(summary.schemas)
        schemas = [json.loads(schema.data) for schema in summary.schemas.values()]
        assert all(schema["type"] == "object" for schema in schemas)
        (one,) = [schema for schema in schemas if schema["title"] == "estimates"]
        assert one["properties"]["angle_rad"] == {"type": "number", "description": "in rad"}
        about = {meta.name: meta.metadata for meta in reader.iter_metadata()}
    assert about["gyrohil.capture"]["hold"] == "zoh"


def test_an_mcap_file_without_numbers_where_there_are_none(tmp_path):
    """Times before zero begin at the first; what is not finite is left out, as JSON has no word for it."""
    columns = {"t_s": np.array([-1.5, 0.25]), "x_m": np.array([np.nan, 2.0])}
    table = Exported("estimates", 2, {"t_s": "s", "x_m": "m"}, lambda: iter([columns]))
    write_mcap([table], tmp_path / "a.mcap")
    ((times, told),) = messages(tmp_path / "a.mcap").values()
    assert times.tolist() == [0, 1_750_000_000]
    assert told == [{"t_s": -1.5}, {"t_s": 0.25, "x_m": 2.0}]


def test_names_that_matlab_has_not_are_written_as_it_has_them(tmp_path):
    columns = {"t_s": np.zeros(2), "a:2": np.ones(2), "a_2": np.full(2, 2.0), "2φ": np.full(2, 3.0)}
    write_mat([Exported("estimates", 2, dict.fromkeys(columns, ""), lambda: iter([columns]))], tmp_path / "a.mat")
    read = loadmat(tmp_path / "a.mat", simplify_cells=True)["estimates"]
    assert {name: float(values[0]) for name, values in read.items() if name not in ("units", "about")} == {
        "t_s": 0.0, "a_2": 1.0, "a_2_2": 2.0, "c_2_": 3.0,
    }  # fmt: skip


@pytest.mark.parametrize("to", FORMATS)
def test_an_empty_record_is_written_as_one(tmp_path, to):
    _WRITERS[to]([Exported("capture", 0, {"t_s": "s", "vx_V": "V"}, lambda: iter([]))], tmp_path / f"empty.{to}")
    assert (tmp_path / f"empty.{to}").stat().st_size > 0


@pytest.mark.moderate
def test_refusals_leave_nothing(folder, tmp_path):
    target = tmp_path / "out" / "ride"
    for to, what, words in (
        ("arrow", (), "known are csv, parquet, mat, mcap"),
        ("mat", ("angel",), "--what: angel is not known"),
        ("csv", ("angle", "rate"), "holds one table, not 2"),
        ("csv", ("force",), "no force to export"),
    ):
        with pytest.raises(InputError, match=words):
            export(folder, target, to, what)
    with pytest.raises(InputError, match="it holds estimates"):
        export(folder / "estimates.arrow", target, "csv", ("capture",))
    with pytest.raises(InputError, match="cannot be read"):
        export(tmp_path / "nothing.arrow", target, "csv")
    (tmp_path / "bare").mkdir()
    with pytest.raises(InputError, match=r"there is no capture\.arrow in it"):
        export(tmp_path / "bare", target, "csv")
    with pytest.raises(InputError, match="nothing to export"):
        export(tmp_path / "bare", target, "mcap")
    assert not target.parent.exists()


@pytest.mark.moderate
def test_a_file_of_estimates_is_exported_by_itself(folder, tmp_path):
    assert export(folder / "estimates.arrow", tmp_path / "e.csv", "csv").rows == {"estimates": 200}
    header = (tmp_path / "e.csv").read_text().partition("\n")[0].split(",")
    assert header[0] == "t_s"
    assert {"angle_rad", "angle_u_rad", "sd_rate_rad_s"} <= set(header)


@pytest.mark.moderate
def test_the_library_exports_by_the_name_of_the_file(folder, tmp_path):
    run = hil.load(folder)
    assert hil.export(run, tmp_path / "angle.parquet", what="angle") == tmp_path / "angle.parquet"
    np.testing.assert_array_equal(pq.read_table(tmp_path / "angle.parquet")["angle_rad"].to_numpy(), run.angle.values)
    assert set(messages(hil.export(folder, tmp_path / "two.mcap", what=("angle", "rate")))) == {"/angle", "/rate"}
    with pytest.raises(InputError, match="exists already"):
        hil.export(run, tmp_path / "two.mcap")
    with pytest.raises(InputError, match="known are csv, parquet, mat, mcap"):
        hil.export(run, tmp_path / "two.arrow")
