"""Files from before `angle_expanded_rad` are read with their numbers under the names of today."""

import json
from pathlib import Path

import pytest

from hil.records.methods import Methods, load_methods
from hil.records.result import Result, load_result, save_result


def test_a_result_of_version_1_had_the_expanded_uncertainty(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    old = {"version": 1, "run": "r", "seconds": 1.0, "samples": 10, "angle_u_rad": 0.283, "complete": True}
    path.write_text(json.dumps(old))
    found = load_result(path)
    assert (found.angle_u_rad, found.angle_expanded_rad, found.version) == (pytest.approx(0.1415), 0.283, 2)
    (remark,) = found.remarks
    assert "angle_u_rad was the expanded uncertainty (k = 2)" in remark
    save_result(path, found)
    assert load_result(path) == found  # and told once


def test_without_an_angle_there_is_nothing_to_say(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text(json.dumps({"version": 1, "run": "r", "seconds": 1.0, "samples": 10, "complete": True}))
    found = load_result(path)
    assert (found.angle_u_rad, found.angle_expanded_rad, found.remarks) == (None, None, ())
    assert Result(run="r", seconds=1.0, samples=1, complete=True).version == 2


def test_a_comparison_without_a_version_had_expanded_ones(tmp_path: Path) -> None:
    path = tmp_path / "comparison.json"
    row = {
        "name": "13 states, EKF", "kind": "observer", "record": "this", "angle_u_rad": 0.02, "rate_u_rad_s": 0.1,
        "stiffness_u": 1e-6, "damping_u": 1e-3,
    }  # fmt: skip
    old = {"record": "r", "bench": "b", "seconds": 1.0, "window_s": [0.0, 1.0], "rows": [row]}
    path.write_text(json.dumps(old))
    found = load_methods(path)
    (read,) = found.rows
    assert (read.angle_u_rad, read.angle_expanded_rad) == (0.01, 0.02)
    assert (read.rate_expanded_rad_s, read.stiffness_expanded, read.damping_expanded) == (0.1, 1e-6, 1e-3)
    assert "expanded ones (k = 2)" in found.remarks[0]
    path.write_text(found.model_dump_json())
    assert load_methods(path) == found
    assert Methods.model_validate(found.model_dump()) == found
