"""A tabulated gain beside the EKF with fading memory, over memories and devices that the bench file does not know.

S-slow in lockstep, both axes declared at the target stiffness, the device's own k ± 0, 2 and 5 % apart and kxy half of
that; a constant rate of 90 °/s, scored over the last 10 s.
"""

import math
from dataclasses import dataclass

from benchmarks.lockstep import bench_of, close_loop, rms, scenario_of, slope
from benchmarks.row import Row, Say

TARGET = 1579.1
RATE = math.pi / 2
SCORED_S = 10.0
MEMORIES_S = (0.1, 0.3, 1.0, 3.0, 10.0)
MISMATCHES = (0.0, 0.02, 0.05)


@dataclass(frozen=True)
class Outcome:
    """Angle per rotation, innovation over the sense noise and rate error, over the scored window."""

    slope: float
    innovation: float
    rate_error_rad_s: float


def outcome(gain: str, variant: str, memory_s: float, mismatch: float, *, seed: int = 1) -> Outcome:
    """One run, long enough for the table to have taken over two memories, or 4 s, before the scored window."""
    offsets = {"mismatch_m": (0.0, 0.0), "opamp_offset_V": (0.0, 0.0)} if variant == "gyro" else {}
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
    """13 states over all memories and devices; 7 and 11 states at the shipped memory of 1 s."""
    cases = [("full", memory, mismatch) for memory in MEMORIES_S for mismatch in MISMATCHES]
    cases += [(variant, 1.0, 0.05) for variant in ("gyro", "sense")]
    figures = []
    for variant, memory, mismatch in cases:
        table, ekf = (outcome(gain, variant, memory, mismatch) for gain in ("stationary", "fading"))
        what = f"{variant}, memory {memory:g} s, ± {mismatch:.0%}"
        say(what)
        figures += [
            Row(f"{what}, slope less 1", table.slope - 1.0, "1", "fading", (table.slope - 1.0) / (ekf.slope - 1.0)),
            Row(f"{what}, innovation over noise", table.innovation, "1", "fading", table.innovation / ekf.innovation),
            Row(
                f"{what}, rate error", table.rate_error_rad_s, "rad/s", "fading",
                table.rate_error_rad_s / ekf.rate_error_rad_s,
            ),
        ]  # fmt: skip
    return figures
