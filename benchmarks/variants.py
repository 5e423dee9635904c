"""The observers of the other claims on S-slow: 7 states on ring-downs, 11 states without and with sense offsets.

The 7-state observer knows the gyro's parameters and needs no drive: its angle is ∫Ω̂ dt, here over two seconds of free
decay of the mismatched device.  The 11-state observer takes the offsets as zero: right when they are, and on a board
with offsets of 10 % it must finish with the energy in bounds and an innovation that gives it away.
"""

import math
from typing import Any

import numpy as np

from benchmarks.lockstep import bench_of, close_loop, rms, scenario_of, slope
from benchmarks.row import Row, Say

RATE = math.pi / 2
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


def rows(say: Say) -> list[Row]:
    """Ring-downs with each gain, closed loops without and with offsets."""
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
    return figures
