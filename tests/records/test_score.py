"""The score against runs whose errors are known by construction."""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from hil.errors import InputError
from hil.records.estimates import Estimates
from hil.records.result import load_result
from hil.records.truth import read_truth
from hil.scoring.score import (
    angle_error_rad,
    estimation_error_rad,
    pattern_angle_rad,
    score,
    scored_window,
)
from tests.records.synthetic_run import MASS_KG, TRUE, D, K, Options, write_run, write_truth_columns


@pytest.mark.moderate
def test_a_good_run(make_run):
    folder, truth = make_run(virtual_rotation_rad_s=5.0)
    result = score(folder, truth)
    assert result == load_result(folder / "result.json")
    assert result.angle_error_rms_rad == pytest.approx(2e-4, rel=0.5)
    assert result.rate_error_rms_rad_s == pytest.approx(0.2 * 4e-3, rel=0.15)
    figures = result.score
    assert figures.window_s == pytest.approx((0.5, 1.9975))
    assert figures.rows == 600
    assert figures.turns == pytest.approx(
        (1.57 * 1.4975 + 0.6 / np.pi * (np.cos(np.pi * 0.5) - np.cos(np.pi * 1.9975))) / 2 / np.pi, rel=1e-6
    )
    assert figures.angle_per_rotation == pytest.approx(1.0, abs=5e-5)
    for name in ("x_m", "vx_mps", "y_m", "vy_mps", "phi_x_V", "phi_y_V", "rate_rad_s"):
        assert figures.coverage[name] == pytest.approx(0.95, abs=0.04)
    assert figures.coverage.keys() == {
        *TRUE,
        "x_m",
        "vx_mps",
        "y_m",
        "vy_mps",
        "phi_x_V",
        "phi_y_V",
        "rate_rad_s",
    }


@pytest.mark.moderate
def test_what_the_board_hides_is_the_effect_of_that_name(make_run):
    _, truth_file = make_run()
    truth = read_truth(truth_file)
    hidden = [
        {"name": "cubic_stiffness", "coefficients": {"k3x": 1e13, "k3y": 3e12}},
        {"name": "base_vibration", "coefficients": {"ax": 2.0, "frequency": 50.0}},
    ]
    board = replace(truth, header=truth.header | {"effects": hidden})
    assert board.coefficients(["cubic_stiffness", "constant_force"]) == {"k3x": 1e13, "k3y": 3e12}
    assert truth.coefficients(["cubic_stiffness"]) == {}
    gain = {"name": "sense_gain", "coefficients": {"gx": 0.01, "gy": 0.0}}
    scaled = replace(truth, header=truth.header | {"effects": [*hidden, gain]})
    assert scaled.coefficients(["cubic_stiffness"]) == {}


@pytest.mark.moderate
def test_parameters_stand_beside_their_truth(make_run):
    folder, truth = make_run()
    parameters = score(folder, truth).parameters
    assert list(parameters) == ["phi_x", "phi_y", "kxx", "kyy", "kxy", "dxx", "dyy", "dxy"]
    assert parameters["kxx"].truth == pytest.approx(1.02 * K)
    assert parameters["dxy"].truth == pytest.approx(0.02 * D)
    assert parameters["phi_y"].truth == pytest.approx(-6e-3)
    assert parameters["kyy"].unit == "1/s²"
    for entry in parameters.values():
        low, high = entry.ci95
        assert low < entry.value < high


@pytest.mark.moderate
def test_unnormalised_parameters_carry_the_mass(make_run):
    folder, truth = make_run(normalised=False)
    parameters = score(folder, truth).parameters
    assert parameters["kxx"].truth == pytest.approx(1.02 * K * MASS_KG)
    assert parameters["kxx"].value == pytest.approx(1.02 * K * MASS_KG, rel=1e-3)
    assert (parameters["kxx"].unit, parameters["dxx"].unit, parameters["phi_x"].unit) == ("N/m", "N·s/m", "V")


@pytest.mark.moderate
def test_a_drifting_pattern_is_the_control_s_and_not_the_estimate_s(make_run):
    drift = 0.02
    folder, truth = make_run(angle_drift=drift)
    result = score(folder, truth)
    length = 1.5
    expected = drift * length / np.sqrt(3)
    assert result.angle_error_rms_rad == pytest.approx(expected, rel=0.05)
    assert result.score.control_imperfection_rms_rad == pytest.approx(expected, rel=0.1)
    assert result.score.angle_estimation_error_rms_rad < 0.1 * expected
    rotation = result.score.turns * 2 * np.pi
    assert result.score.angle_per_rotation - 1 == pytest.approx(drift * length / rotation, rel=0.2)


@pytest.mark.moderate
def test_the_angle_error_is_zero_where_scoring_starts_and_signed(make_run):
    folder, truth_file = make_run(angle_drift=0.05)
    estimates, truth = Estimates.read(folder / "estimates.arrow"), read_truth(truth_file)
    window = scored_window(estimates, truth, 1.0)
    error = angle_error_rad(estimates, truth, window)
    assert window.t_s[0] == 1.0
    assert error[0] == 0.0
    assert error[-1] == pytest.approx(0.05 * (window.t_s[-1] - 1.0), abs=2e-3)


@pytest.mark.moderate
def test_an_estimate_turned_one_way_is_an_error_of_the_other_sign_in_phi(make_run):
    folder, truth_file = make_run()
    estimates, truth = Estimates.read(folder / "estimates.arrow"), read_truth(truth_file)
    window = scored_window(estimates, truth, 1.0)
    turn = 0.01
    columns = dict(estimates.columns)
    x, y, vx, vy = (truth[name][window.true] for name in ("x_m", "y_m", "vx_mps", "vy_mps"))
    for names, (first, second) in ((("x_m", "y_m"), (x, y)), (("vx_mps", "vy_mps"), (vx, vy))):
        turned = (np.cos(turn) * first - np.sin(turn) * second, np.sin(turn) * first + np.cos(turn) * second)
        for name, values in zip(names, turned, strict=True):
            columns[name] = columns[name].copy()
            columns[name][window.estimated] = values
    turned_estimates = type(estimates)(columns, estimates.header, True)
    error = estimation_error_rad(turned_estimates, truth, window)
    np.testing.assert_allclose(error, -turn, rtol=1e-6)


@pytest.mark.parametrize("angle", [-1.2, -0.3, 0.0, 0.7, 1.5])
def test_the_pattern_formula_finds_a_slender_ellipse(angle):
    phase = np.linspace(0, 6, 50)
    along, across = np.cos(phase), 0.1 * np.sin(phase)
    along_dot, across_dot = -3 * np.sin(phase), 0.3 * np.cos(phase)
    c, s = np.cos(angle), np.sin(angle)
    state = np.stack(
        [
            c * along - s * across,
            c * along_dot - s * across_dot,
            s * along + c * across,
            s * along_dot + c * across_dot,
        ]
    )
    np.testing.assert_allclose(pattern_angle_rad(state, 9.0, np.zeros(50)), angle, atol=1e-12)


@pytest.mark.parametrize("spin", [0.9, -0.4])
def test_the_angle_formula_follows_a_virtually_rotated_ellipse(spin):
    """z̈ + 2iWż + kz = 0 is ẅ + (k + W²) w = 0 in a frame that turns with −W: there the ellipse rests."""
    k, angle, t = 9.0, 0.7, np.linspace(0.0, 5.0, 60)
    nu = np.sqrt(k + spin**2)
    w = np.exp(1j * angle) * (np.cos(nu * t) + 0.3j * np.sin(nu * t))
    w_dot = nu * np.exp(1j * angle) * (-np.sin(nu * t) + 0.3j * np.cos(nu * t))
    z, z_dot = np.exp(-1j * spin * t) * w, np.exp(-1j * spin * t) * (w_dot - 1j * spin * w)
    found = pattern_angle_rad(np.stack([z.real, z_dot.real, z.imag, z_dot.imag]), k, np.full(60, spin))
    off = (found - (angle - spin * t) + np.pi / 2) % np.pi - np.pi / 2
    np.testing.assert_allclose(off, 0.0, atol=1e-12)


@pytest.mark.moderate
def test_a_killed_run_is_scored_too(make_run):
    folder, truth = make_run(interrupted=True, result=False)
    result = score(folder, truth)
    assert not result.complete
    assert result.samples == 8000
    assert result.angle_error_rms_rad == pytest.approx(2e-4, rel=0.5)
    assert load_result(folder / "result.json") == result


@pytest.mark.moderate
def test_figures_of_the_run_are_kept(make_run):
    folder, truth = make_run()
    before = load_result(folder / "result.json")
    after = score(folder, truth)
    changed = {"angle_error_rms_rad", "rate_error_rms_rad_s", "parameters", "score"}
    assert after.model_dump(exclude=changed) == before.model_dump(exclude=changed)


@pytest.mark.moderate
def test_a_single_axis_has_no_angle(make_run):
    folder, truth = make_run(axes=1)
    result = score(folder, truth)
    assert result.angle_error_rms_rad is None
    assert result.score.angle_per_rotation is None
    assert result.parameters["kxx"].truth == pytest.approx(1.02 * K)
    assert result.parameters["drive_gain_x"].truth is None


@pytest.mark.moderate
def test_a_run_that_ended_before_it_settled_is_told_as_such(make_run):
    folder, truth = make_run(seconds=0.375)
    before = (folder / "result.json").read_bytes()
    with pytest.raises(InputError, match=r"ended after 0\.37\d s, before settle_s = 0\.5 s"):
        score(folder, truth)
    assert (folder / "result.json").read_bytes() == before


def table_in(truth_file):
    with pa.ipc.open_stream(str(truth_file)) as stream:
        return stream.read_all()


def written(file, table):
    """A truth of the columns of `table` at `file`, which it returns."""
    columns = {name: table[name].to_numpy() for name in table.column_names}
    write_truth_columns(file, columns, json.loads(table.schema.metadata[b"gyrohil"]))
    return file


@pytest.mark.moderate
def test_a_truth_of_every_tenth_sample_is_enough(make_run, tmp_path):
    folder, truth_file = make_run()
    table = table_in(truth_file)
    sparse = written(tmp_path / "sparse.arrow", table.take(list(range(0, table.num_rows, 25))))
    figures = score(folder, sparse).score
    assert figures.rows == 120  # every 25th and every 10th sample meet every 50
    assert figures.angle_error_end_rad is not None


@pytest.mark.moderate
@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"tick": np.arange(8000) + 10**6}, "fewer than two instants in common"),
        ({"angle_rad": None}, "a truth file without angle_rad"),
        ({"stiffness_per_s2": None}, "a truth file without stiffness_per_s2"),
    ],
)
def test_a_truth_that_does_not_fit_is_refused_and_changes_nothing(make_run, tmp_path, change, complaint):
    folder, truth_file = make_run()
    table = table_in(truth_file)
    about = json.loads(table.schema.metadata[b"gyrohil"])
    columns = {name: table[name] for name in table.column_names}
    for name, values in change.items():
        if values is None:
            columns.pop(name, None)
            about.pop(name, None)
        else:
            columns[name] = pa.array(values)
    changed = pa.table(columns).replace_schema_metadata({b"gyrohil": json.dumps(about)})
    other = written(tmp_path / "other.arrow", changed)
    before = (folder / "result.json").read_bytes()
    with pytest.raises(InputError, match=complaint):
        score(folder, other)
    assert (folder / "result.json").read_bytes() == before


@pytest.mark.moderate
def test_a_folder_without_records_is_refused(tmp_path, make_run):
    _, truth = make_run()
    with pytest.raises(InputError, match="no run folder"):
        score(tmp_path, truth)


@pytest.mark.moderate
def test_a_capture_is_no_truth(make_run):
    folder, _ = make_run()
    with pytest.raises(InputError, match="holds 'capture', not 'truth'"):
        score(folder, folder / "capture.arrow")


@pytest.mark.moderate
def test_rotation_back_and_forth_is_added_up(make_run, tmp_path):
    folder, truth_file = make_run()
    table = table_in(truth_file)
    swing = 0.5 * np.cos(2 * np.pi * table["tick"].to_numpy() / 4000)
    index = table.column_names.index("angle_rad")
    other = written(
        tmp_path / "swing.arrow",
        table.set_column(index, "angle_rad", pa.array(swing)).replace_schema_metadata(table.schema.metadata),
    )
    assert score(folder, other).score.turns == pytest.approx(3 * 1.0 / (2 * np.pi), rel=1e-3)


@pytest.mark.moderate
def test_the_truth_of_another_run_is_refused(make_run, tmp_path):
    folder, _ = make_run()
    other = write_run(tmp_path / "other", Options(seed=2))
    before = (folder / "result.json").read_bytes()
    with pytest.raises(InputError, match=r"of another run: at tick \d+ its vx_code is not the one in .*capture\.arrow"):
        score(folder, other)
    assert (folder / "result.json").read_bytes() == before


@pytest.mark.moderate
def test_one_changed_code_is_another_run(make_run, tmp_path):
    folder, truth_file = make_run()
    table = table_in(truth_file)
    drive = table["uy_code"].to_numpy().copy()
    drive[5432] += 1
    changed = table.set_column(table.column_names.index("uy_code"), "uy_code", pa.array(drive))
    other = written(tmp_path / "other.arrow", changed)
    with pytest.raises(InputError, match="of another run: at tick 5432 its uy_code"):
        score(folder, other)


@pytest.mark.moderate
def test_an_old_truth_without_codes_is_taken_with_a_remark(make_run, tmp_path):
    folder, truth_file = make_run()
    table = table_in(truth_file)
    table = table.drop_columns([name for name in table.column_names if name.endswith("_code")])
    old = written(tmp_path / "old.arrow", table)
    for _ in range(2):
        remarks = score(folder, old).remarks
    assert remarks == ("whether the truth is that of this run cannot be told: the truth has no codes to compare",)


def cut(truth_file, share):
    """The truth up to that share of its bytes, or without so many of its last ones."""
    data = truth_file.read_bytes()
    kept = truth_file.with_name("cut.arrow")
    kept.write_bytes(data[: int(share * len(data)) if share > 0 else share])
    return kept


@pytest.mark.moderate
@pytest.mark.parametrize(("share", "end"), [(2 / 3, r"1\.2\d*"), (0.2, r"0\.24\d+")])
def test_a_truth_that_ends_before_the_run_is_refused_wherever_it_was_cut(make_run, share, end):
    folder, truth = make_run()
    before = (folder / "result.json").read_bytes()
    complaint = (
        rf"cut\.arrow: ends at {end} s, cut off: its end marker is missing, and the run at 1\.998 s; give the whole"
    )
    with pytest.raises(InputError, match=complaint):
        score(folder, cut(truth, share))
    assert (folder / "result.json").read_bytes() == before


@pytest.mark.moderate
def test_a_truth_that_was_ended_early_is_refused_too(make_run, tmp_path):
    folder, truth_file = make_run()
    short = written(tmp_path / "short.arrow", table_in(truth_file).slice(0, 7990))
    with pytest.raises(InputError, match=r"short\.arrow: ends at 1\.997 s, and the run at 1\.998 s"):
        score(folder, short)


@pytest.mark.moderate
def test_a_truth_without_its_end_is_told_until_a_whole_one_comes(make_run):
    folder, truth = make_run(every=2300)  # a plain stream loses its last block so; the last estimate is before it
    told = score(folder, cut(truth, -20))
    assert told.score.rows == 3
    (remark,) = told.remarks
    assert remark.endswith("cut.arrow: cut off: its end marker is missing; it covers the whole run")
    assert score(folder, truth).remarks == ()


@pytest.mark.moderate
def test_of_an_interrupted_run_the_truth_may_end_early_and_is_told(make_run):
    folder, truth = make_run(interrupted=True, result=False)
    result = score(folder, cut(truth, 2 / 3))
    assert 250 < result.score.rows < 400
    told, *records = result.remarks
    assert told.endswith("and the run at 1.998 s; scored is what it covers")
    assert [record.partition(", without an end marker")[0].rpartition(" ")[0] for record in records] == [
        "capture.arrow: the record was interrupted: it ends after row",
        "estimates.arrow: the record was interrupted: it ends after row",
    ]


def test_a_truth_without_a_row_is_none(make_run, tmp_path):
    folder, truth_file = make_run()
    empty = written(tmp_path / "empty.arrow", table_in(truth_file).slice(0, 0))
    with pytest.raises(InputError, match=r"empty\.arrow: a truth without a row, cut off"):
        score(folder, empty)


@pytest.mark.moderate
def test_parts_make_no_difference(make_run, monkeypatch):
    folder, truth = make_run(virtual_rotation_rad_s=5.0, angle_drift=0.02)
    whole = score(folder, truth).model_dump()
    monkeypatch.setattr("hil.records.blocks.pieces_of.__defaults__", (77,))
    parts = score(folder, truth).model_dump()
    for name, value in whole["score"].items():
        assert parts["score"][name] == (None if value is None else pytest.approx(value, rel=1e-9)), name
    for name in ("angle_error_rms_rad", "rate_error_rms_rad_s"):
        assert parts[name] == pytest.approx(whole[name], rel=1e-9)
    assert parts["parameters"] == whole["parameters"]
