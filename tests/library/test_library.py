"""`import hil`: a run, its arrays, a replay and a trace of it, as README and docs/reference/library.md promise."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import hil
from hil.records.runfolder import RunFolder

RATE = 4000.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> hil.Run:
    place = tmp_path_factory.mktemp("library")
    bench = hil.load_bench("s-slow").with_(loop={"duration_s": 3.0, "settle_s": 1.0})
    return hil.run(bench, link="inproc:s-slow", clock="lockstep", truth=place / "truth.arrow", out=place)


@pytest.fixture
def opened(whole_run: Path) -> hil.Run:
    return hil.load(whole_run)


@pytest.mark.moderate
def test_importing_loads_nothing_heavy() -> None:
    program = "import hil, sys; print(*[m for m in ('numpy', 'numba', 'pyarrow', 'estimator') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


@pytest.mark.slow
def test_opening_what_is_there_loads_no_estimator(run: hil.Run) -> None:
    heavy = ("numba", "sympy", "scipy", "matplotlib", "hil.bench", "estimator.observer")
    program = f"import hil, sys; run = hil.load({str(run.path)!r}); run.verdict, run.angle.values[-1], run.innovation; "
    program += f"print(*[m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


@pytest.mark.slow
def test_arrays_need_no_models_of_figures(run: hil.Run) -> None:
    program = f"import hil, sys; run = hil.load({str(run.path)!r}); run.angle.values[-1], run.rate, run.innovation; "
    program += "print('pydantic' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.moderate
def test_last_is_the_newest_run_wherever_one_is_named(
    whole_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(hil.InputError, match="runs"):
        hil.load("last")
    for name in ("20250101-000000-older", "20250102-000000-newer"):
        shutil.copytree(whole_run, tmp_path / "runs" / name)
    assert hil.load("last").path.name == "20250102-000000-newer"
    assert hil.export("last", tmp_path / "angle.csv", what="angle").exists()
    assert not [row for row in hil.diff("last", whole_run).figures if row.a != row.b]


@pytest.mark.moderate
def test_a_run_and_a_trace_are_opened_each_by_its_own_verb(whole_run: Path, tmp_path: Path) -> None:
    with pytest.raises(hil.InputError, match=r"a run, no trace; hil\.load opens it"):
        hil.load_trace(whole_run)
    with pytest.raises(hil.InputError, match="no trace; give the folder"):
        hil.load_trace(tmp_path)
    (tmp_path / "diagnosis.json").write_text("{}", encoding="utf-8")
    with pytest.raises(hil.InputError, match=r"a trace, no run; hil\.load_trace opens it"):
        hil.load(tmp_path)


def test_all_that_is_offered_is_there() -> None:
    for name in hil.__all__:
        assert getattr(hil, name) is not None
    assert set(dir(hil)) == {*hil.__all__, "open"}  # which `from hil import *` must not put over Python's own
    with pytest.raises(AttributeError, match="nonsense"):
        hil.nonsense  # noqa: B018


def test_a_run_as_arrays(opened: hil.Run) -> None:
    kept = RunFolder(opened.path)
    assert kept.estimates is not None
    assert kept.capture is not None
    assert opened.verdict in ("good", "failed")
    assert np.array_equal(opened.angle.values, kept.estimates["angle_rad"])
    assert (opened.angle.unit, opened.rate.unit) == ("rad", "rad/s")
    assert np.array_equal(opened.rate["sd_rate_rad_s"], kept.estimates.sd("rate_rad_s"))
    assert opened.angle.columns == ("angle_rad", "angle_u_rad", "valid")
    assert len(opened.capture) == 1.5 * RATE
    assert np.allclose(opened.capture["vy_V"], kept.capture.sense_V[:, 1])
    assert opened.capture.units["ux_mps2"] == "m/s²"
    settled = opened.innovation.since(0.5)
    assert settled.values.std() < 2.0 * np.median(settled["s_x_V"])
    late = opened.angle.since(1.0)
    assert late.t_s[0] >= 1.0
    assert late.values[-1] == opened.angle.values[-1]
    assert np.asarray(late).shape == late.t_s.shape
    assert opened.report().stat().st_size > 10_000


def test_flags_choose_rows(opened: hil.Run) -> None:
    """Bytes in their place would be the numbers of rows, 0 and 1."""
    for series in (opened.angle, opened.estimates):
        assert series["valid"].dtype == bool
    valid = opened.angle["valid"]
    assert opened.angle.values[valid].size == np.count_nonzero(valid)
    assert opened.angle.to_pandas()["valid"].dtype == bool


def test_tables_keep_units_and_values(opened: hil.Run) -> None:
    table = opened.angle.to_arrow()
    assert table.column_names == ["t_s", "angle_rad", "angle_u_rad", "valid"]
    assert table.schema.field("angle_u_rad").metadata[b"unit"] == b"rad"
    frame = opened.angle.to_pandas()
    assert frame.index.name == "t_s"
    assert np.array_equal(frame["angle_rad"].to_numpy(), opened.angle.values)


@pytest.mark.long
def test_a_replay_of_a_run_by_its_own_bench_is_the_same(run: hil.Run, tmp_path: Path) -> None:
    again = hil.replay(run, out=tmp_path)
    assert np.allclose(again.rate.values, run.rate.values, atol=1e-9)
    assert again.path.parent == tmp_path


@pytest.mark.long
def test_arrays_without_a_file_are_replayed_as_the_record_is(run: hil.Run, tmp_path: Path) -> None:
    arrays = {"t_s": run.capture.t_s, **{name: run.capture[name] for name in run.capture.columns}}
    from_arrays = hil.replay(arrays, run.bench, out=tmp_path)
    assert np.allclose(from_arrays.rate.values, run.rate.values, atol=1e-6)


@pytest.mark.slow
def test_a_score_puts_the_truth_beside_the_run(run: hil.Run) -> None:
    scored = hil.score(run, run.path.parent / "truth.arrow")
    assert scored.result.angle is not None
    assert run.result is not None
    assert "Angle per rotation" in scored.report().read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"t_s": [0.0, 1.0]}, "vx_V"),
        ({"vx_V": [0.0, 1.0]}, "no column t_s"),
        ({"t_s": [0.0, 1.0, 2.0], "vx_V": [1.0, 2.0]}, "vx_V: 2 values where t_s has 3"),
        ({"t_s": [0.0, 2.0, 1.0], "vx_V": [1.0, 2.0, 3.0]}, "not later"),
        ({"t_s": [0.0, 1.0], "vx_V": [1.0, float("nan")]}, r"vx_V\[1\]: nan is no measurement"),
        ({"t_s": [0.0, 1.0], "vx_V": [[1.0], [2.0]]}, "shape"),
        ({"t_s": [0.0, 1.0], "vx_V": ["a", "b"]}, "no array of numbers"),
        ({"t_s": [0.0], "vx_V": [1.0]}, "at least two"),
    ],
)
def test_arrays_that_are_no_record_are_refused_with_the_column(columns: dict, words: str, tmp_path: Path) -> None:
    with pytest.raises(hil.InputError, match=words) as told:
        hil.replay(columns, "s-slow", out=tmp_path)
    assert "\n" not in str(told.value)
    assert not list(tmp_path.iterdir())


def test_a_board_that_may_move_is_not_armed_unasked() -> None:
    with pytest.raises(hil.InputError, match="needs arm=True"):
        hil.run("s-slow", link="serial:/dev/ttyACM0")


def test_what_is_not_there_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(hil.InputError, match="no run folder"):
        hil.load(tmp_path)
    with pytest.raises(hil.InputError, match="no such bench file"):
        hil.load_bench("s-slov")
    with pytest.raises(hil.InputError, match="no bench"):
        hil.replay(tmp_path / "capture.arrow")
