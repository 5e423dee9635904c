"""Only whole regular files are read, to a bound; of every other one line says what it is."""

import gzip
import os
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat
from scipy.sparse import csc_array

from device_emulator.rate import FromFile, pieces
from device_emulator.scenario import ScenarioError, load
from hil.bench.bench import Bench
from hil.bench.examples import find
from hil.errors import InputError
from hil.exporting.exported import tables_of
from hil.importing.importer import import_file
from hil.importing.request import ImportRequest
from hil.records.blocks import scan_blocks
from hil.records.capture import read_capture
from hil.records.direct import DirectRecord
from hil.records.force import is_force, load_force
from hil.records.json_file import load as load_json
from hil.records.kind import fresh
from hil.records.result import Result
from hil.records.runs import listed
from hil.service.catalogue.entry import read_entry
from hil.toml.reading import parse_table, read_table
from tests.interchange.written import T_S, X_V

PLAIN = "t_s,vx_V\n" + "".join(f"{t},{v}\n" for t, v in zip(T_S, X_V, strict=True))
VX = 'hold = "zoh"\n[columns]\nt_s = { column = "t", unit = "s" }\nvx_V = { column = NAME, unit = "V" }\n'


def refused(source: Path, mapping: str | None = None) -> str:
    map_file = None
    if mapping is not None:
        map_file = source.parent / "m.map.toml"
        map_file.write_text(mapping, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        import_file(ImportRequest(source, source.parent / "o.arrow", map_file=map_file))
    line = str(caught.value)
    assert "\n" not in line
    return line


def named(place: Path) -> dict[str, Path]:
    os.mkfifo(place / "fifo")
    (place / "link").symlink_to(place / "fifo")
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(place / "socket"))
    return {
        "a named pipe": place / "fifo", "a device": Path("/dev/zero"), "a directory": place, "link": place / "link",
        "a socket": place / "socket", "of the kernel": Path("/proc/kmsg"), "kernel's text": Path("/proc/cpuinfo"),
    }  # fmt: skip


KINDS = ("a named pipe", "a device", "a directory", "link", "a socket", "of the kernel", "kernel's text")
TOLD = {"link": "a named pipe", "of the kernel": "made by the kernel", "kernel's text": "made by the kernel"}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_file_is_no_record_either(tmp_path: Path, kind: str) -> None:
    path, told = named(tmp_path)[kind], f"is {TOLD.get(kind, kind)}"
    for read in (lambda: read_capture(path), lambda: scan_blocks(path, None), lambda: DirectRecord(path)):
        with pytest.raises(InputError, match=told):
            read()
    for read_table_of in (lambda: tables_of(path, ()), lambda: load_force(path)):
        if not path.is_dir():
            with pytest.raises(InputError, match=told):
                read_table_of()
    assert not is_force(path)
    with pytest.raises(InputError, match=told):
        load_json(path, Result, give="another", anew="make it anew")


@pytest.mark.parametrize("name", ["capture.arrow", "bench.toml", "result.json", "diagnosis.json"])
def test_a_pipe_in_a_run_folder_holds_nobody_up(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "20250314-092653-pipe"
    folder.mkdir()
    os.mkfifo(folder / name)
    if name == "result.json":
        (folder / "capture.arrow").write_bytes(b"")
    assert all(one.unreadable or not one.verdict for one in listed(tmp_path))
    assert read_entry(folder).verdict is None


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_file_is_not_read(tmp_path: Path, kind: str) -> None:
    path, told = named(tmp_path)[kind], TOLD.get(kind, kind)
    with pytest.raises(InputError, match=f"is {told}"):
        import_file(ImportRequest(path, tmp_path / "o.arrow"))
    with pytest.raises(InputError, match=f"is {told}"):
        read_table(path)
    with pytest.raises(ScenarioError, match=f"is {told}"):
        load(path)
    with pytest.raises(ScenarioError, match=f"is {told}"):
        pieces(FromFile(kind="file", path=str(path)))


def test_a_line_without_an_end(tmp_path: Path) -> None:
    """Of 600 MB of zeros in 2.6 MB, some 8 MB are read."""
    path = tmp_path / "bomb.csv.gz"
    with gzip.open(path, "wb", 1) as file:
        file.write(b"t_s,vx_V\n")
        for _ in range(60):
            file.write(b"0" * 1_000_000)
    assert "bomb.csv.gz:2: a line of more than 4 MB" in refused(path)


def test_a_file_that_unpacks_to_far_more_than_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.importing.text_lines._UNPACKED_BYTES", 1 << 22)
    path = tmp_path / "rows.csv.gz"
    path.write_bytes(gzip.compress(b"t_s,vx_V\n" + b"0.0,1.0\n" * 3_000_000, 9))
    assert "unpacks to more than 200 times its" in refused(path)
    rows = "".join(f"{row / 1000:.3f},{value:.9f}\n" for row, value in enumerate(np.sin(np.arange(300_000.0))))
    path.write_bytes(gzip.compress(("t_s,vx_V\n" + rows).encode()))
    assert len(import_file(ImportRequest(path, tmp_path / "o.arrow")).capture) == 300_000


@pytest.mark.parametrize("encoding", ["utf-32", "utf-32-le", "utf-32-be"])
def test_text_of_four_bytes_a_letter(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "f.csv"
    path.write_bytes(PLAIN.encode(encoding))
    if encoding == "utf-32":  # with its mark
        assert len(import_file(ImportRequest(path, tmp_path / "o.arrow")).capture) == len(T_S)
    else:
        assert f'set encoding = "{encoding}"' in refused(path)


@pytest.mark.parametrize("form", ["5", "4"])
@pytest.mark.parametrize("packed", [False, True])
def test_a_matlab_file_that_is_cut(tmp_path: Path, form: str, packed: bool) -> None:
    path = tmp_path / "f.mat"
    rest = np.random.default_rng(3).normal(size=4000)
    savemat(path, {"t": T_S, "x": X_V, "rest": rest}, format=form, do_compression=packed and form == "5")
    mapping = VX.replace("NAME", '"x"')
    whole = path.read_bytes()
    (tmp_path / "m.map.toml").write_text(mapping)
    import_file(ImportRequest(path, tmp_path / "o.arrow", map_file=tmp_path / "m.map.toml"))
    for kept in (len(whole) - 1, len(whole) // 2):
        path.write_bytes(whole[:kept])
        assert "is cut: it has" in refused(path, mapping)


MATLAB: dict[str, tuple[Any, str]] = {
    "z": (X_V + 1j, "is complex; save its real part"),
    "cell": (np.array([[T_S], [X_V]], dtype=object), "is a cell array; give one of its cells, as cell{1}"),
    "s": (csc_array(np.diag(X_V)), "is sparse; save full(s)"),
    "x3": (np.zeros((60, 2, 2)), "is 60 by 2 by 2; give one of its columns, as x3(:,1,1)"),
    "txt": ("abc", "is text; give a variable of numbers"),
}


@pytest.mark.parametrize("name", MATLAB)
def test_a_variable_of_another_kind(tmp_path: Path, name: str) -> None:
    savemat(tmp_path / "f.mat", {"t": T_S, name: MATLAB[name][0]})
    assert f"variable {name} {MATLAB[name][1]}" in refused(tmp_path / "f.mat", VX.replace("NAME", f'"{name}"'))


def imu(place: Path) -> Path:
    struct = pa.StructArray.from_arrays([pa.array(X_V), pa.array(2 * X_V)], ["gyro", "accel"])
    columns = [
        pa.array(T_S),
        pa.array([[0.0]] * 60),
        struct,
        pa.array(3 * X_V),
        pa.array(["1.0"] * 60),
        pa.array(4 * X_V),
    ]
    pq.write_table(pa.Table.from_arrays(columns, ["t", "lst", "st", "ref", "txt", "ref"]), place / "f.parquet")
    return place / "f.parquet"


def test_positions_of_parquet_are_those_of_its_columns(tmp_path: Path) -> None:
    path = imu(tmp_path)
    for position, factor in ((4, 3.0), (6, 4.0)):
        (tmp_path / "m.map.toml").write_text(VX.replace("NAME", str(position)))
        capture = import_file(ImportRequest(path, tmp_path / "o.arrow", map_file=tmp_path / "m.map.toml")).capture
        np.testing.assert_array_equal(capture.sense_V[:, 0], factor * X_V)
    told = "column 3 is the struct st; give one of its fields: st.gyro, st.accel"
    assert told in refused(path, VX.replace("NAME", "3"))
    assert "the file has 6 columns" in refused(path, VX.replace("NAME", "7"))
    assert "at positions 4 and 6" in refused(path, VX.replace("NAME", '"ref"'))


def test_a_struct_and_a_text_of_parquet(tmp_path: Path) -> None:
    path = imu(tmp_path)
    assert "st is a struct; give one of its fields: st.gyro, st.accel" in refused(path, VX.replace("NAME", '"st"'))
    assert "column txt: string is no number; map another column" in refused(path, VX.replace("NAME", '"txt"'))


def test_a_header_that_stands_again(tmp_path: Path) -> None:
    lines = PLAIN.replace("t_s,vx_V", "t,x").split("\n")
    path = tmp_path / "f.csv"
    path.write_text("\n".join([*lines[:31], "t,x", *lines[31:]]))
    told = refused(path, VX.replace("NAME", '"x"'))
    assert 'f.csv:32: column t (t_s): the header stands here again; set comment = "t,x", header = false' in told
    assert "missing" not in told
    mapping = 'comment = "t,x"\nheader = false\n' + VX.replace("NAME", "2").replace('"t"', "1")
    (tmp_path / "m.map.toml").write_text(mapping)
    capture = import_file(ImportRequest(path, tmp_path / "o.arrow", map_file=tmp_path / "m.map.toml")).capture
    assert (len(capture), capture.lost) == (60, 0)


def test_nothing_is_written_over_a_device(tmp_path: Path) -> None:
    for path in (Path("/dev/full"), tmp_path):
        with pytest.raises(InputError, match=r"exists already; give another name$"):
            fresh(path, replace=True)


@pytest.mark.parametrize(
    ("key", "matrix"),
    [
        ("stiffness_N_per_m", [1560.0, 1595.0, 9999.0]),
        ("damping_N_s_per_m", [1e-3, 1e-3, 2e-3]),
        ("damping_N_s_per_m", [-1e-3, 1e-3, 0.0]),
        ("damping_N_s_per_m", [-1e-3, -1e-3, 0.0]),
        ("damping_N_s_per_m", [-1e-3, -1e-3, 2e-3]),
    ],
)
def test_a_bench_file_with_a_matrix_that_gives_energy(key: str, matrix: list[float]) -> None:
    table = read_table(find("bench", "s-slow"))
    for other in ("resonance_Hz", "split_Hz", "azimuth_deg", "decay_s", "quality_factor"):
        table["device"].pop(other, None)
    table["device"] |= {"stiffness_N_per_m": [1560.0, 1595.0, 0.0], "damping_N_s_per_m": [1e-3, 1e-3, 0.0]}
    parse_table(table, Bench, "b")
    table["device"][key] = matrix
    with pytest.raises(InputError, match=r"a matrix .xx, yy, xy. that could add energy"):
        parse_table(table, Bench, "b")
