"""A gyro whose two channels show a velocity, as piezoelectric layers do: run, replay and trace beside the truth."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.bench import Bench, examples, load_bench, override
from hil.errors import InputError
from hil.records.result import Result
from hil.records.runfolder import RunFolder
from hil.replaying.replay import replay
from hil.running.safety.preflight import require_suitable
from hil.toml.reading import toml_value
from hil.tracing.request import request_of
from hil.tracing.trace import trace
from tests.running.closed import angle_errors, close_loop, waiting
from tests.running.misbehaving import Board
from tests.running.test_force_loop import innovation_ratio

GAIN = {"mode": "gain", "block": 20, "estimate_every": 20}


def bench(duration_s: float = 1.0, **loop: Any) -> Bench:
    """S-piezo made short, in lockstep."""
    usual = {"duration_s": duration_s, "settle_s": 0.4 * duration_s, "clock": "lockstep", "seed": 7}
    return override(load_bench(examples.find("bench", "s-piezo")), {"loop": usual | loop}, "test")


def scenario(path: Path, *effects: dict[str, Any]) -> Path:
    """S-piezo's board at a constant rate of 1 rad/s, with effects that no bench file knows."""
    table = tomllib.loads(examples.find("scenario", "s-piezo").read_text(encoding="utf-8"))
    table["rate"] = {"kind": "constant", "rate_rad_s": 1.0}
    lines = [f"seed = {table.pop('seed')}"]
    for section, keys in table.items():
        lines += [f"[{section}]", *(f"{key} = {toml_value(value)}" for key, value in keys.items())]
    for effect in effects:
        lines += ["[[effect]]", *(f"{key} = {toml_value(value)}" for key, value in effect.items())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("loop", [{}, GAIN], ids=["force", "gain"])
def test_the_loop_closes_on_a_velocity(tmp_path: Path, loop: dict[str, Any]) -> None:
    truth = tmp_path / "truth.arrow"
    declared = bench(2.0, **loop)
    run, counters = close_loop(waiting(scenario(tmp_path / "board.toml"), truth), declared, tmp_path / "run")
    assert innovation_ratio(run) == pytest.approx(1.0, abs=0.05)
    assert np.abs(angle_errors(run, truth, 1.0)).max() < 5e-3
    assert run.estimates is not None
    settled = run.estimates.t_s >= 1.0
    assert np.abs(run.estimates["energy_ratio"][settled] - 1.0).max() < 0.05
    assert run.estimates["kxx_per_s2"][-1] == pytest.approx(1610719.0, rel=1e-3)
    assert run.estimates["phi_x_V"][-1] == pytest.approx(2e-4 * (1.0 + 1e-3) + 2e-3, abs=2e-5)
    assert (counters.lost, counters.board["late"]) == (0, 0)


@pytest.mark.slow
def test_a_replay_finds_what_the_run_found(tmp_path: Path, no_report: None) -> None:
    declared = bench(4.0)
    run, _ = close_loop(waiting(scenario(tmp_path / "board.toml")), declared, tmp_path / "run")
    folder = replay(run.capture_path, declared, tmp_path / "again", progress=lambda _: None).folder
    assert folder is not None
    again = RunFolder(folder)
    assert run.estimates is not None
    assert again.estimates is not None
    np.testing.assert_allclose(again.estimates["rate_rad_s"][-1], run.estimates["rate_rad_s"][-1], atol=1e-3)
    result: Result | None = again.result
    assert result is not None
    assert result.scan is not None
    assert result.scan.complete is True, result.scan.reason


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_trace_names_what_springs_and_amplifiers_do(tmp_path: Path) -> None:
    """A cubic spring; and Rf Cf, by which a current amplifier is late, which no record tells from a late drive."""
    declared = bench(6.0)
    hard = {"name": "cubic_stiffness", "k3x": 1e13, "k3y": 3e12}
    run, _ = close_loop(waiting(scenario(tmp_path / "board.toml", hard)), declared, tmp_path / "run")
    request = request_of(run.capture_path, declared, {"report": False})
    found = trace(request, tmp_path / "traced", progress=lambda _: None).diagnosis
    assert found.verdict == "explained", found.reasons
    coefficients = {symbol: one for effect in found.effects for symbol, one in effect.coefficients.items()}
    assert [effect.name for effect in found.effects] == ["cubic_stiffness", "drive_delay"]
    for symbol, true in (("k3x", 1e13), ("k3y", 3e12)):
        assert coefficients[symbol].value == pytest.approx(true, rel=0.02)
    for symbol in ("tux", "tuy"):
        assert coefficients[symbol].value == pytest.approx(1e6 * 5e-13, rel=0.2)


def test_the_levels_of_a_velocity_are_those_of_the_vibration() -> None:
    """0.126 m/s at 200 Hz and 100 µm, times 0.7 V per m/s; ten times that is beyond the converter."""
    declared = bench()
    assert declared.swing_V == pytest.approx([0.7 * 1e-4 * 2.0 * np.pi * 200.0] * 2, rel=1e-4)
    identity = Board().identity._replace(tick_rate_Hz=4000.0)
    require_suitable(declared, identity, "serial:x")
    loud = declared.with_(device={"sense": {"gain_V_per_m": (-7.0,)}})
    with pytest.raises(InputError, match="converter ends at"):
        require_suitable(loud, identity, "serial:x")


def test_an_acceleration_of_two_axes_is_refused() -> None:
    with pytest.raises(InputError, match='senses: "acceleration" is for axes = 1'):
        bench().with_(device={"sense": {"senses": "acceleration"}})
