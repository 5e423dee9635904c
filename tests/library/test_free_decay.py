"""A free response that comes to rest: what brought it there is told by the part that moves."""

from pathlib import Path

import numpy as np
import pytest

import hil
from estimator.scaling import Array

BENCH = """
[device]
name = "slider"
axes = 1
mass_kg = 0.02
stiffness_N_per_m = [1250.0]
damping_N_s_per_m = [0.012]
amplitude_m = 0.001
sample_rate_Hz = 800.0

[device.sense]
gain_V_per_m = 450.0
noise_V = 0.0004
offset_sd_V = 0.03

[device.drive]
unit = "mps2"
full_scale = 60.0

[loop]
clock = "lockstep"

[observer]
gain = "ekf"

[observer.initial_sd]
stiffness = 0.03
damping = 1.0

[observer.process_noise]
force_mps2_per_rtHz = 6e-07

[controller]
enabled = false
"""
STIFFNESS, DAMPING, FRICTION = 1250.0 / 0.02 * 1.01, 0.012 / 0.02 * 1.2, 0.23  # 1/s², 1/s, m/s²
GAIN, NOISE, OFFSET, RATE = 450.0, 4e-4, 0.013, 800.0


def coulomb(amplitude: float, samples: int) -> Array:
    """Free decay with Coulomb friction in its closed form, swing by swing: between two turning points it is that of a
    linear oscillator about ± f/k, and at a turning point that the friction holds it ends (Den Hartog, Mechanical
    Vibrations, 4th ed., § 8.7).
    """
    time = np.arange(samples) / RATE
    decay, centre = DAMPING / 2.0, FRICTION / STIFFNESS
    omega = np.sqrt(STIFFNESS - decay**2)
    half = np.pi / omega
    position, turned, begun = np.empty(samples), amplitude, 0.0
    while abs(turned) > centre:
        about = np.copysign(centre, turned)
        now = (time >= begun) & (time < begun + half)
        t = time[now] - begun
        swing = np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))
        position[now] = about + (turned - about) * swing
        turned, begun = about - (turned - about) * np.exp(-decay * half), begun + half
    position[time >= begun] = turned
    return position


@pytest.mark.long
@pytest.mark.timeout(600)
def test_the_friction_of_a_mass_that_sticks_is_found(tmp_path: Path) -> None:
    """Nine tenths of the record are at rest; friction, drag and an asymmetric one all predict them."""
    bench = tmp_path / "slider.bench.toml"
    bench.write_text(BENCH, encoding="utf-8")
    volts = OFFSET + GAIN * coulomb(1e-3, 12_000) + np.random.default_rng(8).normal(0.0, NOISE, 12_000)
    record = {"t_s": np.arange(12_000) / RATE, "vx_V": volts}
    told: list[str] = []
    found = hil.trace(
        record, hil.load_bench(bench), report=False, out=tmp_path, progress=lambda one: told.append(one.stage)
    ).diagnosis
    assert "effects" in told
    (effect,) = found.effects
    assert (found.verdict, effect.name) == ("explained", "dry_friction")
    low, high = effect.coefficients["fx"].ci95
    assert low < FRICTION < high
    assert high - low < 0.05 * FRICTION
    (said,) = found.prepared
    assert said.startswith("the motion has come to rest at 1.")
    assert said.endswith("--fraction uses them")
    held_out = found.held_out
    assert held_out.before.ratio > 10.0 > 1.1 > held_out.after.ratio
    whole = hil.trace(record, hil.load_bench(bench), fraction=0.6, report=False, out=tmp_path).diagnosis
    assert whole.prepared == ()  # as it was asked for
