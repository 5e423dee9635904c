"""Laws of damping and friction against the motion in the plane, beside those of each axis: each is found as itself."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.lockstep import bench_of, close_loop, scenario_of
from device_emulator.scenario import Scenario
from estimator.diagnosis import Verdict
from estimator.effects.catalogue import EFFECTS
from estimator.trace.problem import Problem
from estimator.trace.trace import trace
from evaluation.undeclared.record import write_capture
from hil.inputs.captured import control_of
from hil.inputs.declared import device_of, observer_settings_of
from hil.records.capture import read_capture
from hil.tracing.trace import record_of

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]  # loops of 24,000 samples, and traces of them

SAMPLES = 24_000
RADIAL = tuple(effect.name for effect in EFFECTS if effect.plane and effect.name.endswith("_radial"))


@pytest.mark.parametrize("name", RADIAL)
def test_a_radial_law_is_named_beside_that_of_each_axis(tmp_path: Path, name: str) -> None:
    bench = bench_of("s-slow", controller={"amplitude_modulation": 0.3})
    device = device_of(bench)
    fastest = device.amplitude * float(np.sqrt(device.target))
    linear = device.damping[0]
    hidden = {
        "nonlinear_damping_radial": {"d3r": 0.8 * linear / device.amplitude**2},
        "drag_radial": {"dqr": 0.8 * linear / fastest},
        "cubic_damping_radial": {"dcr": 0.8 * linear / fastest**2},
        "dry_friction_radial": {"fr": 0.8 * linear * fastest, "v0": 0.05 * fastest},
    }[name]
    scenario = Scenario.model_validate(scenario_of("s-slow").model_dump() | {"effect": [{"name": name, **hidden}]})
    write_capture(tmp_path / "capture.arrow", close_loop(scenario, bench, SAMPLES, seed=3, every=1000), scenario, None)
    capture = read_capture(tmp_path / "capture.arrow")
    settings = observer_settings_of(bench)
    problem = Problem(record_of(capture), device, settings, control_of(bench, capture))
    said = trace(problem, split=round(0.6 * SAMPLES))
    assert said.verdict is Verdict.EXPLAINED
    (found,) = said.effects
    assert found.name == name
    for symbol, true in hidden.items():
        interval = found.coefficients[symbol]
        assert abs(interval.value - true) < interval.high - interval.low, symbol  # two half-widths
