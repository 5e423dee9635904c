"""Angle per rotation in lockstep: 60 dB, ±2 % stiffness, 20 samples a cycle, latencies 0, 1 and 3, ten turns after
convergence.  S-slow with a constant rate of 1e-3 ω0 (and 1e-4 ω0), virtual rotation at most 5e-3 ω0.
"""

import math

from benchmarks.lockstep import bench_of, close_loop, scenario_of, slope
from benchmarks.row import Row, Say

OMEGA0 = 2.0 * math.pi * 200.0
SETTLE = 8000
VIRTUAL = 5e-3
TURNS = 10.0


def angle_per_rotation(rate: float, latency: int, turns: float, dither: float, seed: int = 1) -> tuple[float, float]:
    """(slope of the reported angle over the true one, slope of the plain pattern angle), rate in units of ω0."""
    true_rate = rate * OMEGA0
    scenario = scenario_of(
        "s-slow", drive={"latency_samples": latency}, rate={"kind": "constant", "rate_rad_s": true_rate}
    )
    bench = bench_of(
        "s-slow",
        controller={"virtual_rotation_rad_s": VIRTUAL * OMEGA0, "dither_mps2": dither},
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


def rows(say: Say) -> list[Row]:
    """Angle per rotation less 1, of the reported angle and of the pattern with only the virtual rotation taken off."""
    figures = []
    for rate, dither, latencies in ((1e-3, 0.0, (0, 1, 3)), (1e-3, 0.3, (1,)), (1e-4, 0.0, (0, 1, 3))):
        for latency in latencies:
            reported, pattern = angle_per_rotation(rate, latency, TURNS, dither)
            label = f"Ω {rate:.0e} ω0, latency {latency}" + (f", dither {dither:g} m/s²" if dither else "")
            say(f"{label}: {reported - 1.0:+.2e}")
            figures.append(Row(f"{label}, angle per rotation − 1", reported - 1.0, "1"))
            figures.append(Row(f"{label}, pattern angle per rotation − 1", pattern - 1.0, "1"))
    return figures
