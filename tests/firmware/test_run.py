"""`hil run` against the C board: a verdict, and the truth that its source states."""

from pathlib import Path

import pytest

from hil.bench import Bench, load_bench, override
from hil.loop.run import run
from hil.progress import Progress
from hil.records.runfolder import RunFolder

from .process import pty_board

BENCH = Path(__file__).parents[2] / "examples" / "c-board.bench.toml"
TRUTH = {
    "phi_x": 6e-3,
    "phi_y": -4e-3,
    "kxx": 1.602e6,
    "kyy": 1.561e6,
    "kxy": -1.2e4,
    "dxx": 1.5,
    "dyy": 1.3,
    "dxy": 0.05,
}
"""firmware/examples/pty_board.c"""


@pytest.fixture
def declared() -> Bench:
    return load_bench(BENCH)


def quietly(_: Progress) -> None:
    """Watch nothing."""


@pytest.mark.slow
@pytest.mark.parametrize("rate_rad_s", [1.0, -0.7])
def test_a_run_in_lockstep_is_good_and_right(
    built: Path, declared: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rate_rad_s: float
) -> None:
    monkeypatch.setattr("hil.report.write_report", lambda _: None)
    with pty_board(built, "--rate", str(rate_rad_s)) as (_, url):
        done = run(declared, url, tmp_path, progress=quietly)
    assert done.folder is not None
    folder = RunFolder(done.folder)
    result = folder.result
    assert result is not None
    assert (result.verdict, result.reasons, result.lost, result.late) == ("good", (), 0, 0)
    for name, truth in TRUTH.items():
        estimate = result.parameters[name]
        sd = (estimate.ci95[1] - estimate.ci95[0]) / 3.92
        assert abs(estimate.value - truth) < 5.0 * sd, name
    estimates = folder.estimates
    assert estimates is not None
    scored = estimates.t_s >= declared.loop.settle_s
    angle, t = estimates["angle_rad"][scored], estimates.t_s[scored]
    assert (angle[-1] - angle[0]) / (t[-1] - t[0]) == pytest.approx(rate_rad_s, abs=2e-3)


@pytest.mark.slow
def test_latency_of_the_board_is_believed(
    built: Path, declared: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hil.report.write_report", lambda _: None)
    shorter = override(declared, {"loop": {"duration_s": 4.0, "settle_s": 2.0}}, "test")
    for latency in ("0", "3"):
        with pty_board(built, "--latency", latency) as (_, url):
            done = run(shorter, url, tmp_path / latency, progress=quietly)
        assert done.folder is not None
        result = RunFolder(done.folder).result
        assert result is not None
        assert result.verdict == "good"
