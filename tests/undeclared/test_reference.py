"""A record that says how fast it was turned has a vote on what explains it: a drive gain of one axis, single-tone."""

from dataclasses import replace

import numpy as np
import pytest

from device_emulator.scenario import Scenario
from estimator.diagnosis import Diagnosis, Verdict
from estimator.record import Record
from estimator.trace.problem import Problem
from estimator.trace.trace import trace
from evaluation.undeclared.device import bench_table, draw_device, scenario_table
from evaluation.undeclared.effects import Hidden
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import Drawn, keep, recorded
from hil.bench import Bench, load_bench
from hil.inputs.captured import control_of, drives_of, record_of
from hil.inputs.declared import device_of, observer_settings_of
from hil.records.capture import read_capture
from hil.toml.reading import parse_table

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]

SAMPLES = 30_000
NOISE_RAD_S = 2e-3


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, float]:
    """The record without a reference, and the rate at which the emulated device was turned."""
    order = Order("fixed", ("drive_gain",), 0, 1)
    rng = np.random.default_rng(order.seed)
    device = draw_device(rng, crest=1.0, slow=True)
    rate = {"kind": "constant", "rate_rad_s": device.rate_rad_s * float(rng.uniform(-1.0, 1.0))}
    hidden = Hidden([{"name": "drive_gain", "hx": 0.056}], 0.0)
    table = scenario_table(device, rate, order.seed) | {"effect": hidden.effects}
    bench_keys = bench_table(device, SAMPLES / device.sample_rate_Hz, excited=False, turning=False)
    drawn = Drawn(
        device, [hidden], table, Scenario.model_validate(table), parse_table(bench_keys, Bench, order.name), False
    )
    place = tmp_path_factory.mktemp("single-tone") / order.name
    keep(drawn, recorded(drawn, order, SAMPLES), order, place)
    bench, capture = load_bench(place / "bench.toml"), read_capture(place / "capture.arrow")
    declared = device_of(bench, capture.noise_gain)
    record = record_of(capture, drives_of(capture, declared))
    problem = Problem(record, declared, observer_settings_of(bench), control_of(bench, capture))
    return problem, drawn.table["rate"]["rate_rad_s"]


def told(problem: Problem, rate_rad_s: float) -> Diagnosis:
    noise = NOISE_RAD_S * np.random.default_rng(1).standard_normal(SAMPLES)
    record: Record = replace(problem.record, channels={**problem.record.channels, "rate": rate_rad_s + noise})
    return trace(replace(problem, record=record), split=6 * SAMPLES // 10)


def test_what_mends_the_angle_is_explained(asked: tuple[Problem, float]) -> None:
    said = told(*asked)
    assert (said.verdict, [effect.name for effect in said.effects]) == (Verdict.EXPLAINED, ["drive_gain"])
    before, after = said.held_out_before.angle_error_rms, said.held_out_after.angle_error_rms
    assert before is not None
    assert after is not None
    assert after < 0.1 * before


def test_what_mends_the_innovation_and_not_the_angle_is_not(asked: tuple[Problem, float]) -> None:
    """A reference that is off by far more than the angle is uncertain: whatever is named leaves that wrong."""
    problem, rate_rad_s = asked
    said = told(problem, rate_rad_s + 0.3)
    assert said.verdict is not Verdict.EXPLAINED
    against = "on the part held out the error of the angle against the reference was"
    assert any(reason.startswith(against) for reason in said.reasons)
