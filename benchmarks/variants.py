"""The observers of 7 and 11 states, and a tabulated gain beside the EKF, on S-slow at a constant 90 °/s.

The 7-state observer knows the gyro's parameters and needs no drive: its angle is ∫Ω̂ dt, here over two seconds of free
decay of the mismatched device.  The 11-state observer takes the offsets as zero: right when they are, and on a board
with offsets of 10 % it must finish with the energy in bounds and an innovation that gives it away.

A tabulated gain: over memories and devices that the bench file does not know, both axes declared at the target
stiffness, the device's own k ± 0, 2 and 5 % apart and kxy half of that; scored over the last 10 s.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.lockstep import bench_of, close_loop, rms, scenario_of, slope
from benchmarks.row import Row, Say

TARGET = 1579.1
RATE = math.pi / 2
SCORED_S = 10.0
MEMORIES_S = (0.1, 0.3, 1.0, 3.0, 10.0)
MISMATCHES = (0.0, 0.02, 0.05)
NO_OFFSET: dict[str, Any] = {"mismatch_m": (0.0, 0.0), "opamp_offset_V": (0.0, 0.0)}


def ring_down(gain: str, seed: int) -> float:
    """Largest error of ∫Ω̂ dt over a ring-down of 2 s, from 0.2 s on, rad."""
    scenario = scenario_of("s-slow", rate={"kind": "constant", "rate_rad_s": RATE})
    bench = bench_of(
        "s-slow",
        device={
            "stiffness_N_per_m": list(scenario.truth.stiffness_N_per_m),
            "damping_N_s_per_m": list(scenario.truth.damping_N_s_per_m),
        },
        observer={"variant": "sense", "gain": gain},
        controller={"enabled": False},
    )
    run = close_loop(scenario, bench, 8000, seed=seed)
    scored = run.tick >= 800
    error = run.estimates["angle_rate_integral_rad"][scored] - run.at("angle_rad")[scored]
    return float(np.abs(error - error[0]).max())


def eleven_states(offsets: bool, declared: bool, seed: int) -> dict[str, float]:
    """Angle per rotation, largest energy deviation, innovation over its predicted deviation, over 20 s after
    settling.
    """
    scenario = scenario_of("s-slow", rate={"kind": "constant", "rate_rad_s": RATE}, sense={} if offsets else NO_OFFSET)
    bench = bench_of(
        "s-slow",
        observer={"variant": "gyro"},
        controller={"dither_mps2": 0.0},
        device={} if declared else {"sense": {"offset_sd_V": 0.0}},
    )
    run = close_loop(scenario, bench, 100_000, seed=seed)
    scored = run.tick >= 20_000
    return {
        "angle per rotation": slope(run.estimates["angle_rad"][scored], run.at("angle_rad")[scored]),
        "energy, largest deviation": float(np.abs(run.estimates["energy_ratio"][scored] - 1.0).max()),
        "innovation over the noise": rms(run.innovation_V[20_000:].ravel()) / scenario.sense.noise_V,
        "samples": float(len(run.capture)),
    }


@dataclass(frozen=True)
class Outcome:
    """Angle per rotation, innovation over the sense noise and rate error, over the scored window."""

    slope: float
    innovation: float
    rate_error_rad_s: float


def outcome(gain: str, variant: str, memory_s: float, mismatch: float, *, seed: int = 1) -> Outcome:
    """One run, long enough for the table to have taken over two memories, or 4 s, before the scored window."""
    offsets = NO_OFFSET if variant == "gyro" else {}
    true = (TARGET * (1 + mismatch), TARGET * (1 - mismatch), 0.5 * TARGET * mismatch)
    scenario = scenario_of(
        "s-slow", rate={"kind": "constant", "rate_rad_s": RATE}, truth={"stiffness_N_per_m": true}, sense=offsets
    )
    bench = bench_of(
        "s-slow",
        observer={"gain": gain, "variant": variant, "memory_s": memory_s},
        device={
            "stiffness_N_per_m": list(true) if variant == "sense" else [TARGET, TARGET, 0.0],
            **({"damping_N_s_per_m": list(scenario.truth.damping_N_s_per_m)} if variant == "sense" else {}),
            **({"sense": {"offset_sd_V": 0.0}} if variant == "gyro" else {}),
        },
        limits={"residual_safe": 1e9},
    )
    rate_Hz = scenario.board.sample_rate_Hz
    settled = round((max(3.0 * memory_s, memory_s + 4.0)) * rate_Hz)
    run = close_loop(scenario, bench, settled + round(SCORED_S * rate_Hz), seed=seed)
    scored = run.tick >= settled
    return Outcome(
        slope(run.estimates["angle_rad"][scored], run.at("angle_rad")[scored]),
        rms(run.innovation_V[settled:].ravel()) / scenario.sense.noise_V,
        rms(run.estimates["rate_rad_s"][scored] - RATE),
    )


def rows(say: Say) -> list[Row]:
    """Ring-downs with each gain, closed loops without and with offsets, the table over memories and devices."""
    figures = []
    for gain in ("stationary", "ekf", "fading"):
        worst = max(ring_down(gain, seed) for seed in range(5))
        figures.append(Row(f"7 states, {gain}, ring-down, largest error of ∫Ω̂ dt in 5 records", worst, "rad"))
    say("ring-downs done")
    for offsets, declared in ((False, False), (True, True), (True, False)):
        board = "offsets of 10 %" if offsets else "no offsets"
        label = f"11 states, {board}" + (f", {'declared' if declared else 'undeclared'}" if offsets else "")
        for what, value in eleven_states(offsets, declared, 1).items():
            figures.append(Row(f"{label}, {what}", value, "1"))
        say(label)
    cases = [("full", memory, mismatch) for memory in MEMORIES_S for mismatch in MISMATCHES]
    cases += [(variant, 1.0, 0.05) for variant in ("gyro", "sense")]
    for variant, memory, mismatch in cases:
        table, ekf = (outcome(gain, variant, memory, mismatch) for gain in ("stationary", "fading"))
        label = f"tabulated, {variant}, memory {memory:g} s, ± {mismatch:.0%}"
        say(label)
        for what, unit, ours, theirs in (
            ("slope less 1", "1", table.slope - 1.0, ekf.slope - 1.0),
            ("innovation over noise", "1", table.innovation, ekf.innovation),
            ("rate error", "rad/s", table.rate_error_rad_s, ekf.rate_error_rad_s),
        ):
            figures.append(Row(f"{label}, {what}", ours, unit, "fading", ours / theirs))
    return figures
