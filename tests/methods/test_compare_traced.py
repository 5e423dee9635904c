"""`hil compare` with an effect that nobody declared: the row that carries what a trace found beside the plain one."""

import json
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import hil
from hil.bench.examples import find
from hil.cli import execute
from hil.records.methods import load_methods

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]
PLAIN, TRACED = "13 states, fading", "13 states, fading, with cubic_stiffness"
WITHOUT = "13 states, fading, without cubic_stiffness"


class Recorded(NamedTuple):
    """A run on a board with a cubic stiffness, its truth, the trace's folder and the bench file with what it found."""

    run: Path
    truth: Path
    trace: Path
    better: Path


def told(*words: str) -> dict[str, Any]:
    with redirect_stdout(StringIO()) as out:
        assert execute([*words, "--json"]) == 0
    answer: dict[str, Any] = json.loads(out.getvalue())
    return answer


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    place = tmp_path_factory.mktemp("undeclared")
    bench, truth, better = place / "plain.bench.toml", place / "truth.arrow", place / "better.bench.toml"
    text = find("bench", "s-undeclared").read_text(encoding="utf-8")
    text = text.replace("duration_s = 24.0", "duration_s = 14.0").replace("settle_s = 8.0", "settle_s = 6.0")
    bench.write_text(text.replace("pty:s-undeclared", "inproc:s-undeclared"), encoding="utf-8")
    run = hil.run(bench, link="inproc:s-undeclared", clock="lockstep", truth=truth, out=place / "runs")
    traced = told(
        "trace", str(run.path), "--bench", str(bench), "--add", str(better), "--out", str(place / "traces")
    )  # fmt: skip
    assert traced["verdict"] == "explained"
    (folder,) = (place / "traces").iterdir()
    return Recorded(run.path, truth, folder, better)


def compared(recorded: Recorded, place: Path, *more: str) -> hil.Methods:
    found = told(
        "compare", str(recorded.run), "--truth", str(recorded.truth), "--no-report", "--out", str(place), *more
    )  # fmt: skip
    return load_methods(Path(found["folder"]) / "comparison.json")


def test_what_a_trace_found_makes_a_row_that_is_better(recorded: Recorded, tmp_path: Path) -> None:
    bench = recorded.run / "bench.toml"
    found = compared(recorded, tmp_path, "--bench", str(bench), "--diagnosis", str(recorded.trace))
    plain, traced = found.of(PLAIN), found.of(TRACED)
    assert traced.kind == "traced"
    assert_better(traced, plain)


def test_added_to_the_bench_file_it_is_in_every_row_but_one(recorded: Recorded, tmp_path: Path) -> None:
    found = compared(recorded, tmp_path, "--bench", str(recorded.better))
    assert_better(found.of(PLAIN), found.of(WITHOUT))
    with_it = compared(
        recorded, tmp_path, "--bench", str(recorded.run / "bench.toml"), "--diagnosis", str(recorded.trace)
    ).of(TRACED)
    assert found.of(PLAIN).angle_error_rms_rad == pytest.approx(with_it.angle_error_rms_rad, rel=1e-6)
    (remark,) = [remark for remark in found.remarks if "the rotation" in remark]
    assert "leave the effects out" in remark


def assert_better(traced: hil.MethodRow, plain: hil.MethodRow) -> None:
    """Ten times the angle, three times the rate, and the stiffness; and it knows how good it is."""
    assert traced.angle_error_rms_rad is not None
    assert plain.angle_error_rms_rad is not None
    assert traced.angle_expanded_rad is not None
    assert traced.rate_error_rms_rad_s is not None
    assert plain.rate_error_rms_rad_s is not None
    assert 10.0 * traced.angle_error_rms_rad < plain.angle_error_rms_rad
    assert traced.angle_error_rms_rad < traced.angle_expanded_rad
    assert 3.0 * traced.rate_error_rms_rad_s < plain.rate_error_rms_rad_s
    assert (traced.stiffness_error or 1.0) < 0.1 * (plain.stiffness_error or 0.0)
