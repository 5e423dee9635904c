"""Gain mode in lockstep against truth: S-modern at 5 kHz and 100 kS/s, its stiffness split by 4 % and by 40 %, Q 1000,
60 dB, cross-stiffness 1 %, blocks of 250 samples.

Angle per rotation: Ω 1e-3 ω0, virtual rotation 5e-3 ω0, ten turns after convergence, without dither; of the reported
angle and of the pattern with only the virtual rotation taken off.  At 40 % several seeds and 80 dB beside 60: what is
left there is noise, not the matrix.  The drive being known, an unknown rate shows in the motion of the open-loop gyro,
whose modes a split of Δk takes ½ Δk/k off the vibration: its response, and with it what a second tells of the rate,
falls as the split grows (docs/decisions/0014-gain-matrix.md).

Estimates beside force mode: the same device, excitation (dither of 1e-3 k A, virtual rotation) and observer, once with
the board closing the loop and once with the host answering every sample; errors at the ends of 400 segments of one
memory each, after two seconds.
"""

import math
from typing import Any

import numpy as np

from benchmarks.lockstep import ClosedLoop, Floats, bench_of, close_loop, rms, scenario_of, slope
from benchmarks.row import Row, Say

OMEGA0 = 2.0 * math.pi * 5e3
MASS = 1e-8
AMPLITUDE = 2e-6
NOISE_V = 1.77e-4
RATE = 1e-3 * OMEGA0
VIRTUAL = 5e-3 * OMEGA0
TURNS = 10.0
SETTLE_S = 0.5
SEGMENTS = 400
SEGMENT_S = 0.01
UNITS = {"rad_s": "rad/s", "per_s2": "1/s²", "per_s": "1/s"}
STATES = ("rate_rad_s", "kxx_per_s2", "kyy_per_s2", "kxy_per_s2", "dxx_per_s", "dyy_per_s", "dxy_per_s")


def run(
    split: float,
    latency: int,
    seconds: float,
    *,
    mode: str = "gain",
    dither: float = 0.0,
    memory_s: float = 0.2,
    noise_V: float = NOISE_V,
    seed: int = 1,
) -> ClosedLoop:
    """One closed loop; split and dither in units of k and k A."""
    k = MASS * OMEGA0**2
    full = (0.6 * split + 0.08) * OMEGA0**2 * AMPLITUDE
    d = MASS * OMEGA0 / 1000.0
    scenario = scenario_of(
        "s-modern-5k",
        truth={
            "stiffness_N_per_m": [k * (1.0 + split / 2), k * (1.0 - split / 2), 0.01 * k],
            "damping_N_s_per_m": [1.1 * d, 0.9 * d, 0.05 * d],
        },
        sense={"noise_V": noise_V},
        drive={"full_scale_mps2": full, "latency_samples": latency},
        rate={"kind": "constant", "rate_rad_s": RATE},
    )
    bench = bench_of(
        "s-modern-5k",
        device={
            "stiffness_N_per_m": [k * (1.0 + split / 2) * 1.002, k * (1.0 - split / 2) * 0.998, 0.0],
            "damping_N_s_per_m": [d, d, 0.0],
            "sense": {"noise_V": math.hypot(noise_V, 0.5 / 2**16 / math.sqrt(12.0))},
            "drive": {"full_scale": full},
        },
        loop={"mode": mode, "clock": "lockstep", "block": 250, "seed": seed},
        observer={
            "memory_s": memory_s,
            "initial_sd": {"rate_rad_s": 2.0 * RATE},
            "process_noise": {"force_mps2_per_rtHz": 1e-5, "rate_rad_s_per_rts": 0.0},
        },
        controller={
            "target_stiffness_N_per_m": k,
            "virtual_rotation_rad_s": VIRTUAL,
            "dither_mps2": dither * OMEGA0**2 * AMPLITUDE,
        },
        limits={"residual_safe": 1000.0},
    )
    samples = round(seconds * scenario.board.sample_rate_Hz)
    return close_loop(scenario, bench, samples, seed=seed, every=250)


def angle_per_rotation(split: float, latency: int, **settings: Any) -> tuple[float, float, ClosedLoop]:
    """(slope of the reported angle over the true one, of the pattern angle, the run)."""
    loop = run(split, latency, SETTLE_S + 2.0 * math.pi * TURNS / RATE, **settings)
    scored = loop.tick >= SETTLE_S * loop.sample_rate_Hz
    true = loop.at("angle_rad")[scored]
    return (
        slope(loop.estimates["angle_rad"][scored], true),
        slope(loop.estimates["angle_pattern_rad"][scored], true),
        loop,
    )


def errors(loop: ClosedLoop, after_s: float) -> dict[str, Floats]:
    """Errors at the ends of the segments, by name; the angle's from the estimated state, pattern against pattern."""
    rate = loop.sample_rate_Hz
    ends = after_s * rate + np.arange(1, SEGMENTS + 1) * SEGMENT_S * rate
    rows = np.searchsorted(loop.tick, ends - 1.0)
    ticks = loop.tick[rows]
    found = {}
    for name in STATES:
        true = loop.truth[name][ticks] if name in loop.truth else loop.constants[name]
        found[name] = loop.estimates[name][rows] - true
    angles = []
    for source, at in ((loop.estimates, rows), (loop.truth, ticks)):
        x, vx, y, vy = (source[name][at] for name in ("x_m", "vx_mps", "y_m", "vy_mps"))
        k = OMEGA0**2
        angles.append(0.5 * np.arctan2(2 * (k * x * y + vx * vy), k * (x * x - y * y) + vx * vx - vy * vy))
    found["pattern angle"] = (angles[0] - angles[1] + np.pi / 2) % np.pi - np.pi / 2
    return found


def rows(say: Say) -> list[Row]:
    """Slopes at three latencies and two splits; estimates beside force mode."""
    figures = []
    cases: list[tuple[float, int, dict[str, Any]]] = [(0.04, latency, {}) for latency in (0, 1, 2)]
    cases += [(0.4, latency, {}) for latency in (0, 1, 2)]
    cases += [(0.4, 1, {"seed": seed}) for seed in (2, 3, 4)] + [(0.4, 1, {"noise_V": 0.1 * NOISE_V})]
    for split, latency, settings in cases:
        reported, pattern, loop = angle_per_rotation(split, latency, **settings)
        label = f"mismatch {split:.0%}, latency {latency}"
        label += f", seed {settings['seed']}" if "seed" in settings else ""
        label += ", 80 dB" if "noise_V" in settings else ""
        say(f"{label}: reported {reported - 1.0:+.2e}, pattern {pattern - 1.0:+.2e}")
        figures.append(Row(f"{label}, angle per rotation − 1", reported - 1.0, "1"))
        figures.append(Row(f"{label}, pattern angle per rotation − 1", pattern - 1.0, "1"))
        figures.append(Row(f"{label}, deviation of the rate as the observer has it", known_rate(loop), "rad/s"))
    found = {}
    for mode in ("force", "gain"):
        say(f"estimates, {mode} mode")
        loop = run(0.04, 1, 2.0 + SEGMENTS * SEGMENT_S, mode=mode, dither=1e-3, memory_s=SEGMENT_S)
        found[mode] = errors(loop, 2.0)
    for name in found["gain"]:
        gain, force = rms(found["gain"][name]), rms(found["force"][name])
        unit = "rad" if "angle" in name else UNITS[name.split("_", 1)[1]]
        figures.append(Row(f"{name}, rms error of {SEGMENTS} segments", gain, unit, "force mode", gain / force))
    return figures


def known_rate(loop: ClosedLoop) -> float:
    """Standard deviation the observer gives its rate, in the mean over the scored time."""
    return float(np.mean(loop.estimates["sd_rate_rad_s"][loop.tick >= SETTLE_S * loop.sample_rate_Hz]))
