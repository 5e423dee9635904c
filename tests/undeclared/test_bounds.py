"""Bounds of what is not named hold what is there (docs/reference/trace.md, `rejected`), however calm the record."""

from pathlib import Path

import pytest

from benchmarks.lockstep import bench_of, close_loop, scenario_of
from device_emulator.scenario import Scenario
from estimator.diagnosis import Verdict
from estimator.trace.problem import Problem
from estimator.trace.trace import trace
from evaluation.undeclared.record import write_capture
from hil.inputs.declared import device_of, observer_settings_of
from hil.records.capture import read_capture
from hil.tracing.trace import record_of

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]  # a loop of 24,000 samples and its trace

SAMPLES = 24_000


def test_a_stiffness_that_absorbs_a_hardening_does_not_exclude_it(tmp_path: Path) -> None:
    """With a constant amplitude A a hardening k3 r² is a stiffness larger by k3 A²."""
    still = {"virtual_rotation_rad_s": 0.0, "virtual_reversal_s": 0.0, "dither_mps2": 0.0}
    bench = bench_of("s-slow", controller=still)
    device = device_of(bench)
    k3 = 3e-4 * device.stiffness[0] / device.amplitude**2
    table = scenario_of("s-slow", rate={"kind": "constant", "rate_rad_s": 0.0}).model_dump()
    scenario = Scenario.model_validate(table | {"effect": [{"name": "cubic_isotropic", "k3": k3}]})
    write_capture(tmp_path / "capture.arrow", close_loop(scenario, bench, SAMPLES, seed=1, every=1000), scenario, None)
    record = record_of(read_capture(tmp_path / "capture.arrow"))
    said = trace(Problem(record, device, observer_settings_of(bench)), split=round(0.6 * SAMPLES))
    assert said.verdict is Verdict.ADEQUATE
    (bound,) = (one.bound["k3"] for one in said.rejected if one.name == "cubic_isotropic")
    assert bound.low < k3 < bound.high
