"""`hil run` against the C board: a verdict, and the truth that its source states."""

from pathlib import Path

import pytest

from hil.bench import Bench, load_bench, override
from hil.progress import untold
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run

from .process import pty_board

EXAMPLES = Path(__file__).parents[2] / "examples"
SLOW = {
    "phi_x": 6e-3,
    "phi_y": -4e-3,
    "kxx": 1.602e6,
    "kyy": 1.561e6,
    "kxy": -1.2e4,
    "dxx": 1.5,
    "dyy": 1.3,
    "dxy": 0.05,
}
FAST = {"phi_x": 0.012, "phi_y": -0.009, "kxx": 9.873e8, "kyy": 9.865e8, "kxy": 4e5, "dxx": 3.3, "dyy": 3.0, "dxy": 0.1}
"""firmware/examples/pty_board.c"""

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_report")]


def ran(declared: Bench, url: str, place: Path) -> RunFolder:
    """The folder of a run whose verdict is good."""
    done = run(RunRequest(declared, url), place, progress=untold)
    assert done.folder is not None
    folder = RunFolder(done.folder)
    result = folder.result
    assert result is not None
    assert (result.verdict, result.reasons, result.lost, result.late) == ("good", (), 0, 0)
    return folder


def check(folder: RunFolder, truth: dict[str, float], rate_rad_s: float, settle_s: float, tolerance: float) -> None:
    """Parameters within five of their standard deviations of the truth, the angle's slope within `tolerance`."""
    result, estimates = folder.result, folder.estimates
    assert result is not None
    assert estimates is not None
    for name, value in truth.items():
        estimate = result.parameters[name]
        sd = (estimate.ci95[1] - estimate.ci95[0]) / 3.92
        assert abs(estimate.value - value) < 5.0 * sd, name
    scored = estimates.t_s >= settle_s
    angle, t = estimates["angle_rad"][scored], estimates.t_s[scored]
    assert (angle[-1] - angle[0]) / (t[-1] - t[0]) == pytest.approx(rate_rad_s, abs=tolerance)


@pytest.mark.parametrize(("rate_rad_s", "latency"), [(1.0, 1), (-0.7, 3)])
@pytest.mark.beyond(1)
def test_force_mode_in_lockstep_is_good_and_right(built: Path, tmp_path: Path, rate_rad_s: float, latency: int) -> None:
    declared = load_bench(EXAMPLES / "c-board.bench.toml")
    shorter = override(declared, {"loop": {"duration_s": 6.0, "settle_s": 3.0}}, "test")
    with pty_board(built, "--rate", str(rate_rad_s), "--latency", str(latency)) as (_, url):
        folder = ran(shorter, url, tmp_path)
    check(folder, SLOW, rate_rad_s, 3.0, 5e-3)


@pytest.mark.parametrize("latency", [0, 2])
@pytest.mark.long
def test_gain_mode_in_lockstep_is_good_and_right(built: Path, tmp_path: Path, latency: int) -> None:
    declared = load_bench(EXAMPLES / "c-board-gain.bench.toml")
    shorter = override(declared, {"loop": {"clock": "lockstep", "duration_s": 1.5, "settle_s": 0.7}}, "test")
    with pty_board(built, "--fast", "--rate", "1.5", "--latency", str(latency)) as (_, url):
        folder = ran(shorter, url, tmp_path)
    check(folder, FAST, 1.5, 0.7, 5e-3)


@pytest.mark.beyond(1)
@pytest.mark.realtime
@pytest.mark.parametrize("mode", ["force", "gain"])
def test_its_clock_is_this_machines(built: Path, tmp_path: Path, mode: str) -> None:
    """On wall time; it reads the same clock as the host, so that offset and skew are zero to within what is stated."""
    name, options = ("c-board-gain", ("--fast",)) if mode == "gain" else ("c-board", ())
    declared = override(
        load_bench(EXAMPLES / f"{name}.bench.toml"),
        {"loop": {"clock": "paced", "duration_s": 3.0, "settle_s": 1.0}, "limits": {"late_fraction": 1.0}},
        "test",
    )
    with pty_board(built, *options) as (_, url):
        done = run(RunRequest(declared, url), tmp_path, progress=untold)
    assert done.folder is not None
    result = RunFolder(done.folder).result
    assert result is not None
    assert result.board_clock is not None
    found = result.board_clock.relation
    assert found is not None, result.board_clock.unknown
    assert abs(found.offset_ns) <= found.offset_uncertainty_ns < 1e6
    assert abs(found.skew_ppm) <= found.skew_bound_ppm
