"""`hil compare` and `hil.compare`, as docs/reference/compare.md promises, on a short record of S-slow."""

import html
import json
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hil
from hil.cli import execute
from hil.records.methods import load_methods
from tests.records.synthetic_run import Options, write_run

pytestmark = pytest.mark.slow
SECONDS = 3.0
ON_RECORD = [
    *(f"{states} states, {gain}" for states in (7, 11, 13) for gain in ("stationary", "EKF", "fading")),
    "13 states and the rotation, EKF",
    "(a) rate by modulating functions, integrated",
    "(a) rate without sense errors, integrated",
    "(b) formula (11) on raw signals",
    "(b) formula (11), averaged over a cycle",
    "(c) control law without sense errors",
    "(e) Friedland–Hutton",
]
OWN = ["(c) control law without sense errors, its own loop", "(d) Park–Horowitz"]
BOUND = "posterior Cramér–Rao bound"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[hil.Run, Path]:
    place = tmp_path_factory.mktemp("compare")
    bench = hil.load_bench("s-slow").with_(loop={"duration_s": SECONDS, "settle_s": 1.5})
    truth = place / "truth.arrow"
    return hil.run(bench, link="inproc:s-slow", clock="lockstep", truth=truth, out=place), truth


@pytest.fixture(scope="module")
def printed(run: tuple[hil.Run, Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    made, truth = run
    told = ["compare", str(made.path), "--bench", str(made.path / "bench.toml"), "--truth", str(truth), "--json"]
    told += ["--link", "inproc:s-slow", "--out", str(tmp_path_factory.mktemp("compared"))]
    with redirect_stdout(StringIO()) as out:
        assert execute(told) == 0
    answer: dict[str, Any] = json.loads(out.getvalue())
    return answer


@pytest.fixture(scope="module")
def found(printed: dict[str, Any]) -> hil.Methods:
    return load_methods(Path(printed["folder"]) / "comparison.json")


@pytest.mark.long
def test_there_is_a_row_for_every_method_and_the_bound_is_last(found: hil.Methods) -> None:
    assert [row.name for row in found.rows] == [*ON_RECORD, *OWN, BOUND]
    assert found.reference == "truth"
    (remark,) = found.remarks
    assert "assume that the sense offsets are zero, but 0.0089 V are declared" in remark
    assert {row.name for row in found.rows if row.record == "its own"} == set(OWN)


@pytest.mark.long
def test_thirteen_states_are_as_good_as_their_score_says(run: tuple[hil.Run, Path], found: hil.Methods) -> None:
    made, truth = run
    result = hil.score(made, truth).result
    row = found.of("13 states, fading")
    assert row.angle_error_rms_rad == pytest.approx(result.angle_error_rms_rad, rel=0.02)
    assert row.rate_error_rms_rad_s == pytest.approx(result.rate_error_rms_rad_s, rel=0.02)
    assert row.angle_u_rad == pytest.approx(made.result.angle_u_rad, rel=1e-6)  # what the run says of itself
    assert row.angle_expanded_rad == pytest.approx(made.result.angle_expanded_rad, rel=1e-6)
    assert row.angle_rad == pytest.approx(np.ptp(made.angle.since(1.5).values[[0, -1]]), rel=0.02)
    errors = [
        (result.parameters[name].value - (result.parameters[name].truth or 0.0)) for name in ("kxx", "kyy", "kxy")
    ]
    rms = np.sqrt(np.mean(np.square(errors))) / made.bench.target_stiffness_per_s2
    assert row.stiffness_error == pytest.approx(rms, rel=0.02)
    assert row.diverged_s is None
    assert row.settled_s is not None
    assert row.cost_us is not None


@pytest.mark.long
def test_every_method_has_the_figures_of_a_data_sheet(run: tuple[hil.Run, Path], found: hil.Methods) -> None:
    """Of the bench's own observer they are those that `hil characterise` tells of the run."""
    sheets = {row.name: row.sheet for row in found.rows if row.kind != "bound"}
    assert len([sheet for sheet in sheets.values() if "bias" in sheet]) > 8
    value, low, high = sheets["13 states, fading"]["bias"]
    made, truth = run
    own = hil.characterise(made, truth=truth, out=truth.parent / "sheets", report=False)["bias"]
    assert value == pytest.approx(own.value, abs=0.2 * (high - low))
    assert "scale_factor_error" not in sheets["13 states, fading"]  # the record has one rate


@pytest.mark.long
def test_offsets_are_what_harms_eleven_states_and_the_raw_formula(found: hil.Methods) -> None:
    ours = found.of("13 states, fading").angle_error_rms_rad
    assert ours is not None
    theirs = found.of("(b) formula (11) on raw signals").angle_error_rms_rad
    assert theirs is not None
    assert theirs > 10.0 * ours
    eleven = found.of("11 states, fading")
    assert eleven.angle_u_rad is not None
    assert eleven.angle_u_rad > (found.of("13 states, fading").angle_u_rad or 0.0)


@pytest.mark.long
def test_the_bound_has_no_rows_below_it_but_by_chance(found: hil.Methods) -> None:
    bound = found.of(BOUND).angle_error_rms_rad
    assert bound is not None
    assert 0.0 < bound < 10e-3
    for row in found.rows[:-1]:
        assert row.angle_error_rms_rad is None or row.angle_error_rms_rad > 0.1 * bound


@pytest.mark.long
def test_the_command_prints_what_its_folder_holds(
    run: tuple[hil.Run, Path], printed: dict[str, Any], found: hil.Methods
) -> None:
    folder = Path(printed["folder"])
    assert {name: value for name, value in printed.items() if name != "folder"} == found.model_dump(mode="json")
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "<svg" in page
    assert all(name in page for name in (*ON_RECORD, *OWN, BOUND))
    assert (folder / "bench.toml").exists()
    assert f"hil trace {run[0].path} --bench {folder}" in html.unescape(page)  # what comes next


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--link", "serial:/dev/null"], "emulated boards only"),
        (["--trace", "--diagnosis", "x"], "leave out the other"),
        (["--diagnosis", "nowhere.json"], "nowhere.json"),
        (["--bench", "silverbox"], "two"),
        (["--out", "/proc/self/fdinfo"], "no run folder can be made there"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    whole_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    bench = [] if "--bench" in options else ["--bench", str(whole_run / "bench.toml")]
    place = [] if "--out" in options else ["--out", str(tmp_path / "out")]
    assert execute(["compare", str(whole_run), *bench, *options, *place]) == 2
    errors = capsys.readouterr().err.strip().splitlines()
    assert said in errors[-1]
    assert not (tmp_path / "out").exists()


def test_the_truth_of_another_run_is_refused(whole_run: Path, tmp_path: Path) -> None:
    other = write_run(tmp_path / "other", Options(seconds=1.0))
    with pytest.raises(hil.InputError, match="another run"):
        hil.compare(hil.load(whole_run), truth=other, out=tmp_path / "out")


def test_a_truth_that_ends_before_the_record_is_refused(run: tuple[hil.Run, Path], tmp_path: Path) -> None:
    made, truth = run
    cut, kept = tmp_path / "cut.arrow", tmp_path / "kept.arrow"
    cut.write_bytes(truth.read_bytes()[: 2 * truth.stat().st_size // 3])
    kept.write_bytes((made.path / "capture.arrow").read_bytes())
    for record in (made.path, kept):
        with pytest.raises(hil.InputError, match=r"cut\.arrow: ends at .* end marker is missing, and the run at"):
            hil.compare(record, made.bench, truth=cut, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_without_a_reference_there_are_angles_and_no_errors(whole_run: Path, tmp_path: Path) -> None:
    kept = hil.compare(hil.load(whole_run), report=False, out=tmp_path)
    assert kept.reference is None
    assert all(row.angle_error_rms_rad is None and row.angle_rad is not None for row in kept.rows)
    assert [remark.partition(":")[0] for remark in kept.remarks] == [
        "(d) Park–Horowitz",
        "11 states and (c) control law without sense errors",
        "bound",
    ]
