"""Which formula gives the angle: (11) wherever the pattern turns with the board (claims 1 to 10 need no control)."""

from pathlib import Path
from typing import Any

import pytest

from hil.bench import Bench
from hil.inputs.declared import formula_of
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run
from hil.scoring.score import score
from tests.running import gyro

K = 1579.1367  # N/m: 200 Hz with 1 g
IDEAL = {"stiffness_N_per_m": [K, K, 0.0], "damping_N_s_per_m": [0.0, 0.0, 0.0]}
ROTATED = {"kind": "constant", "rate_rad_s": 1.0}


def declared(device: dict[str, Any] = IDEAL, variant: str = "sense", *, controlled: bool = False, **more: Any) -> Bench:
    return gyro.bench(8.0, device=device, observer={"variant": variant}, controller={"enabled": controlled}, **more)


@pytest.mark.parametrize("variant", ["sense", "full"])
def test_an_ideal_gyro_needs_no_control(variant: str) -> None:
    kind, why = formula_of(declared(variant=variant))
    assert kind == "pattern"
    assert "formula (11)" in why
    assert "isotropic and undamped" in why


@pytest.mark.parametrize(
    ("device", "flaw"),
    [
        ({"stiffness_N_per_m": [K, 1.0001 * K, 0.0]}, "its modes, 10\u00a0mHz apart"),
        ({"stiffness_N_per_m": [K, K, 0.5e-4 * K]}, "its modes, 10\u00a0mHz apart"),
        ({"damping_N_s_per_m": [1e-5, 1e-5, 0.0]}, "its damping, which takes 7.7\u00a0% of the energy"),
    ],
)
def test_what_is_not_ideal_says_why(device: dict[str, Any], flaw: str) -> None:
    """By hand: half of 2π 0.01 Hz × 8 s is 0.25 of quadrature; 1 − exp(−0.01 × 8) = 7.7 %."""
    kind, why = formula_of(declared(IDEAL | device))
    assert (kind, "the integrated rate" in why, flaw in why) == ("rate", True, True), why
    kind, why = formula_of(declared(IDEAL | device, "full"))
    assert (kind, flaw in why) == ("none", True), why
    assert formula_of(declared(IDEAL | device, controlled=True)).kind == "pattern"


def test_what_is_stated_is_what_the_limits_allow() -> None:
    nearly = IDEAL | {"stiffness_N_per_m": [K, 1.00001 * K, 0.0], "damping_N_s_per_m": [1e-6, 1e-6, 0.0]}
    assert formula_of(declared(nearly)).kind == "pattern"
    assert formula_of(declared(nearly, limits={"quadrature": 0.01})).kind == "rate"
    assert formula_of(declared(nearly, limits={"energy_error": 0.001})).kind == "rate"


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
@pytest.mark.parametrize("variant", ["sense", "full"])
def test_an_ideal_gyro_that_runs_free_is_read_by_formula_11(tmp_path: Path, variant: str) -> None:
    """Better than its integrated rate, within its own U, and it says by what and why."""
    scenario = gyro.scenario(tmp_path / "ideal.toml", truth=IDEAL, rate=ROTATED)
    truth = tmp_path / "truth.arrow"
    request = RunRequest(declared(variant=variant), f"inproc:{scenario}", {"truth": truth})
    done = run(request, tmp_path / "runs", progress=lambda _: None)
    assert done.folder is not None
    result, folder = score(done.folder, truth), RunFolder(done.folder)
    assert result.angle is not None
    assert result.score is not None
    assert folder.estimates is not None
    assert result.angle.kind == "pattern"
    assert "isotropic and undamped" in result.angle.why
    assert result.angle.rad == pytest.approx(1.0 * 4.8, abs=0.02)
    assert result.angle_error_rms_rad is not None
    assert result.angle_expanded_rad is not None
    assert result.score.angle_error_end_rad is not None
    assert result.score.angle_error_end_rad <= result.angle_expanded_rad
    assert folder.estimates.since(folder.settle_s).valid.all()
    integral = folder.estimates.since(folder.settle_s)["angle_rate_integral_rad"]
    assert result.angle_error_rms_rad < 0.2 * abs(integral[-1] - 4.8) or result.angle_error_rms_rad < 1e-3
