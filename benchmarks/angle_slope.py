"""Angle per rotation in lockstep: 60 dB, ±2 % stiffness, 20 samples a cycle, latencies 0, 1 and 3, ten turns after
convergence.  S-slow with a constant rate of 1e-3 ω0 (and 1e-4 ω0), virtual rotation at most 5e-3 ω0.
"""

import math

from benchmarks.lockstep import bench_of, close_loop, scenario_of, slope

OMEGA0 = 2.0 * math.pi * 200.0
SETTLE = 8000
VIRTUAL = 5e-3


def angle_per_rotation(rate: float, latency: int, turns: float, seed: int = 1) -> tuple[float, float]:
    """(slope of the reported angle over the true one, slope of the plain pattern angle), rate in units of ω0."""
    true_rate = rate * OMEGA0
    scenario = scenario_of(
        "s-slow", drive={"latency_samples": latency}, rate={"kind": "constant", "rate_rad_s": true_rate}
    )
    bench = bench_of(
        "s-slow",
        controller={"virtual_rotation_rad_s": VIRTUAL * OMEGA0, "dither_mps2": 0.0},
        observer={"process_noise": {"rate_rad_s_per_rts": 0.0}},
    )
    samples = SETTLE + math.ceil(2.0 * math.pi * turns / true_rate * scenario.board.sample_rate_Hz)
    run = close_loop(scenario, bench, samples, seed=seed)
    scored = run.tick >= SETTLE
    true = run.at("angle_rad")[scored]
    return (
        slope(run.estimates["angle_rad"][scored], true),
        slope(run.estimates["angle_pattern_rad"][scored], true),
    )
