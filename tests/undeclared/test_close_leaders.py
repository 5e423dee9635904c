"""A record of which the linear scan ranks the truth eighth: its start upsets the estimates; five leaders hide it."""

from pathlib import Path

import pytest

from benchmarks.lockstep import bench_of, close_loop, scenario_of
from device_emulator.scenario import Scenario
from evaluation.undeclared.record import write_capture
from hil.bench.template import template, values_of
from hil.tracing.request import request_of
from hil.tracing.trace import trace

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]  # a trace that carries thirteen, where the kernels may be new


def test_the_truth_is_found_behind_leaders_that_the_scan_ranks_higher(tmp_path: Path) -> None:
    table = scenario_of("s-slow", rate={"kind": "constant", "rate_rad_s": 0.3}).model_dump()
    scenario = Scenario.model_validate(table | {"effect": [{"name": "sense_gain", "gy": 0.012}]})
    calm = {"virtual_rotation_rad_s": 0.0, "virtual_reversal_s": 0.0, "dither_mps2": 0.0}
    bench = bench_of("s-slow", controller=calm)
    write_capture(tmp_path / "capture.arrow", close_loop(scenario, bench, 80_000, seed=1, every=1000), scenario, None)
    (tmp_path / "bench.toml").write_text(template(values_of(bench), "The data sheet."), encoding="utf-8")
    request = request_of(tmp_path / "capture.arrow", tmp_path / "bench.toml", {"report": False})
    found = trace(request, tmp_path / "runs", progress=lambda _: None).diagnosis
    assert [effect.name for effect in found.effects] == ["sense_gain"]
    interval = found.effects[0].coefficients["gy"].ci95
    assert interval[0] is not None
    assert interval[1] is not None
    assert interval[0] < 0.012 < interval[1]
    # Told apart from what the scan ranks before it, so nothing is listed beside it.
    (stated,) = found.probabilities
    assert stated.classes["sense_gain"] > 0.99
    assert found.separations == ()
