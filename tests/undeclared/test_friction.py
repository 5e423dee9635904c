"""Friction that turns over slowly, as lubricated friction does, is found as what it is."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.lockstep import bench_of, close_loop, scenario_of
from device_emulator.scenario import Scenario
from estimator.diagnosis import Verdict
from estimator.trace.problem import Problem
from estimator.trace.trace import trace
from evaluation.undeclared.record import write_capture
from hil.inputs.captured import control_of
from hil.inputs.declared import device_of, observer_settings_of
from hil.records.capture import read_capture
from hil.tracing.trace import record_of

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]  # a loop of 24,000 samples and a trace with a climb

SAMPLES = 24_000


def test_its_size_and_turnover_velocity_lie_in_their_intervals(tmp_path: Path) -> None:
    bench = bench_of("s-slow", controller={"amplitude_modulation": 0.3})
    device = device_of(bench)
    fastest = device.amplitude * float(np.sqrt(device.target))
    friction = {"fx": 0.0, "fy": 0.8 * device.damping[0] * fastest, "v0": 0.25 * fastest}
    table = scenario_of("s-slow").model_dump() | {"effect": [{"name": "dry_friction", **friction}]}
    scenario = Scenario.model_validate(table)
    write_capture(tmp_path / "capture.arrow", close_loop(scenario, bench, SAMPLES, seed=2, every=1000), scenario, None)
    capture = read_capture(tmp_path / "capture.arrow")
    problem = Problem(record_of(capture), device, observer_settings_of(bench), control_of(bench, capture))
    said = trace(problem, split=round(0.6 * SAMPLES))
    assert said.verdict is Verdict.EXPLAINED
    (found,) = said.effects
    assert found.name == "dry_friction"
    for symbol, true in (("fx", 0.0), ("fy", friction["fy"]), ("v0", friction["v0"])):
        interval = found.coefficients[symbol]
        half = 0.5 * (interval.high - interval.low)
        assert abs(interval.value - true) < 1.5 * half, symbol
