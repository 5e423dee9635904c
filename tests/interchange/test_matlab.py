"""MATLAB files as others keep them: structs, columns of matrices, texts, and the bench's own export."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from hil.errors import InputError
from hil.exporting.exporter import export
from hil.importing.importer import import_file
from hil.importing.request import ImportRequest
from hil.records.capture import Capture

T_S = np.arange(50) / 200.0
GYRO = np.column_stack([np.sin(T_S), np.cos(T_S), T_S**2])
NAMES = np.array(["a", "b"] * 25, dtype=object)
FILES = {
    "imu": {"t": T_S[:, None], "wb": GYRO, "freq": 200.0, "names": NAMES, "wide": GYRO.T},
    "runs": np.array([({"x": T_S},), ({"x": 2.0 * T_S},)], dtype=[("log", object)]),
    "cells": np.empty(2, dtype=object),
}
FILES["cells"][:] = [T_S, 3.0 * T_S]  # type: ignore[index]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    savemat(tmp_path / "log.mat", FILES)
    return tmp_path / "log.mat"


def bring(source: Path, column: str, more: str = "") -> Capture:
    mapping = source.parent / "m.toml"
    mapping.write_text(
        f'hold = "zoh"\n{more}[columns]\nt_s = {{ column = "imu.t", unit = "s" }}\n'
        f'vx = {{ column = "{column}", unit = "dps" }}\n',
        encoding="utf-8",
    )
    return import_file(ImportRequest(source, source.parent / "m.arrow", map_file=mapping)).capture


@pytest.mark.parametrize(
    ("column", "values"),
    [
        ("imu.wb(:,3)", GYRO[:, 2]),
        ("imu.wb(:,end)", GYRO[:, 2]),
        ("imu.wide(2,:)", GYRO[:, 1]),
        ("runs(2).log.x", 2.0 * T_S),
        ("cells{2}", 3.0 * T_S),
    ],
)
def test_a_name_as_matlab_writes_it(source: Path, column: str, values: np.ndarray) -> None:
    capture = bring(source, column)
    np.testing.assert_array_equal(capture.sense_V[:, 0], values)
    assert capture.tick_rate_Hz == pytest.approx(200.0)


def test_rows_by_a_text_beside_them(source: Path) -> None:
    capture = bring(source, "imu.wb(:,1)", 'where = { "imu.names" = "b" }\n')
    np.testing.assert_array_equal(capture.sense_V[:, 0], GYRO[1::2, 0])


@pytest.mark.parametrize(
    ("column", "told"),
    [
        ("imu.wb", r"as imu\.wb\(:,1\)"),
        ("imu.wide", r"as imu\.wide\(1,:\)"),
        ("imu", r"imu is a struct; give one of its fields: imu\.t, imu\.wb, "),
        ("imu.wd(:,1)", "no field 'wd' in imu; did you mean 'w"),
        ("imu.wb(:,4)", "is not there: imu.wb is 50 by 3"),
        ("imu.t.x", r"imu\.t is no struct"),
        ("runs.log.x", r"runs is 2 structs; give one of them, as runs\(1\)\.log"),
        ("imu.wb(:,1", "is no name as MATLAB writes it"),
        ("imu.freq", r"unequal length \(imu\.t 50, imu\.freq 1\)"),
        ("imu.names", "no number"),
        ("mu.t", "no variable 'mu'; did you mean 'imu'"),
    ],
)
def test_what_is_no_column_is_told_with_what_would_be_one(source: Path, column: str, told: str) -> None:
    with pytest.raises(InputError, match=told) as caught:
        bring(source, column)
    assert "\n" not in str(caught.value)


def test_a_position_is_none_of_matlab(source: Path) -> None:
    (source.parent / "m.toml").write_text(
        'hold = "zoh"\nsampling_rate_Hz = 1.0\n[columns]\nvx = { column = 2, unit = "V" }\n', encoding="utf-8"
    )
    with pytest.raises(InputError, match="column = 2 is a position, and variables of MATLAB have none"):
        import_file(ImportRequest(source, source.parent / "m.arrow", map_file=source.parent / "m.toml"))


def test_what_the_bench_exports_it_imports(tmp_path: Path) -> None:
    rows = "".join(f"{t:.3f},{x:.6f},{u:.6f}\n" for t, x, u in zip(T_S, GYRO[:, 0], GYRO[:, 1], strict=True))
    (tmp_path / "a.csv").write_text("t_s,vx_V,ux_N\n" + rows)
    capture = import_file(ImportRequest(tmp_path / "a.csv", tmp_path / "a.arrow")).capture
    export(tmp_path / "a.arrow", tmp_path / "a.mat", "mat")
    back = import_file(ImportRequest(tmp_path / "a.mat", tmp_path / "b.arrow")).capture
    np.testing.assert_array_equal(back.sense_V, capture.sense_V)
    np.testing.assert_array_equal(back.drive, capture.drive)
    np.testing.assert_array_equal(back.t_s, capture.t_s)
    assert (back.drive_unit, back.tick_rate_Hz) == ("N", capture.tick_rate_Hz)
