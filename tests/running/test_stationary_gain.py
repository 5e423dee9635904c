"""A gain tabulated once, in the loop against an emulated board whose stiffness the bench file does not know.

With the table of an isotropic device and the shipped memory of 1 s these ended with a slope of 0.16 to 1.0023 and
innovations of 10 to 57 times the noise.
"""

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.variants import outcome
from hil.verdict.budget import budget
from tests.running import gyro
from tests.running.closed import angle_errors, close_loop, waiting

pytestmark = pytest.mark.slow


@pytest.mark.beyond(1)
@pytest.mark.parametrize("variant", ["full", "gyro", "sense"])
def test_at_the_shipped_memory_it_does_what_the_ekf_does(variant: str) -> None:
    found = outcome("stationary", variant, 1.0, 0.05)
    assert found.slope == pytest.approx(1.0, abs=1e-3)
    assert 0.95 < found.innovation < 1.04
    assert found.rate_error_rad_s < 0.05


@pytest.mark.long
@pytest.mark.parametrize("mismatch", [0.0, 0.05])
@pytest.mark.parametrize("memory_s", [0.1, 3.0, 10.0])
def test_whatever_the_memory(memory_s: float, mismatch: float) -> None:
    found = outcome("stationary", "full", memory_s, mismatch)
    assert found.slope == pytest.approx(1.0, abs=1e-3)
    assert 0.95 < found.innovation < 1.04
    assert math.isfinite(found.rate_error_rad_s)


@pytest.mark.long
def test_eleven_states_without_offsets_are_as_sure_as_they_say(tmp_path: Path) -> None:
    """On a board without sense offsets, none being declared: else a run refuses them (hil.bench.by_verb)."""
    scenario = gyro.scenario(tmp_path / "board.toml", sense={"mismatch_m": [0.0, 0.0], "opamp_offset_V": [0.0, 0.0]})
    bench = gyro.bench(
        12.0,
        observer={"variant": "gyro", "gain": "stationary"},
        device={"sense": {"offset_sd_V": 0.0}},
        loop={"duration_s": 12.0, "settle_s": 5.0, "clock": "lockstep", "seed": 7},
    )
    truth = tmp_path / "truth.arrow"
    run, _ = close_loop(waiting(scenario, truth), bench, tmp_path / "run")
    found = budget(run.estimates, bench)
    assert found.angle_u_rad is not None
    assert np.abs(angle_errors(run, truth, 5.0)).max() < found.angle_u_rad
