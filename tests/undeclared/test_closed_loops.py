"""Laws of friction and damping, hidden in a board whose loop is closed: each is found as itself, with its numbers."""

from collections.abc import Callable
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
# Of each, by a share of the linear damping, the amplitude and the largest speed: its coefficients, the seed of its
# record, and how many half-widths of its interval it may be off.
LAWS: dict[str, tuple[Callable[[float, float, float], dict[str, float]], int, float]] = {
    "dry_friction": (lambda d, _, v: {"fx": 0.0, "fy": d * v, "v0": 0.25 * v}, 2, 1.5),  # it turns over slowly
    "stribeck_friction": (lambda d, _, v: {"stx": d * v, "sty": 0.7 * d * v, "v0": 0.03 * v, "vs": 0.3 * v}, 5, 2.0),
    "nonlinear_damping_radial": (lambda d, a, _: {"d3r": d / a**2}, 3, 2.0),
    "drag_radial": (lambda d, _, v: {"dqr": d / v}, 3, 2.0),
    "cubic_damping_radial": (lambda d, _, v: {"dcr": d / v**2}, 3, 2.0),
    "dry_friction_radial": (lambda d, _, v: {"fr": d * v, "v0": 0.05 * v}, 3, 2.0),
}


def test_every_radial_law_is_here() -> None:
    assert {effect.name for effect in EFFECTS if effect.plane and effect.name.endswith("_radial")} <= set(LAWS)


@pytest.mark.parametrize("name", LAWS)
def test_its_numbers_lie_in_their_intervals(tmp_path: Path, name: str) -> None:
    bench = bench_of("s-slow", controller={"amplitude_modulation": 0.3})
    device = device_of(bench)
    law, seed, half_widths = LAWS[name]
    hidden = law(0.8 * device.damping[0], device.amplitude, device.amplitude * float(np.sqrt(device.target)))
    scenario = Scenario.model_validate(scenario_of("s-slow").model_dump() | {"effect": [{"name": name, **hidden}]})
    closed = close_loop(scenario, bench, SAMPLES, seed=seed, every=1000)
    write_capture(tmp_path / "capture.arrow", closed, scenario, None)
    capture = read_capture(tmp_path / "capture.arrow")
    problem = Problem(record_of(capture), device, observer_settings_of(bench), control_of(bench, capture))
    said = trace(problem, split=round(0.6 * SAMPLES))
    assert said.verdict is Verdict.EXPLAINED
    (found,) = said.effects
    assert found.name == name
    for symbol, true in hidden.items():
        interval = found.coefficients[symbol]
        assert abs(interval.value - true) < half_widths * 0.5 * (interval.high - interval.low), symbol
