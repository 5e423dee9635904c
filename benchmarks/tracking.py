"""Following the rate under fading memory: steps, a 30 Hz sine, and then nothing at all for a million samples.

S-classic (amplitude/noise = 20): rate 0, a step to 5 rad/s, a 5 rad/s sine of 30 Hz, then Ω = 0 for 10⁶ samples.
The same at 60 dB, where the lag is not hidden by noise.
"""

import math

import numpy as np

from benchmarks.lockstep import ClosedLoop, Floats, bench_of, close_loop, rms, scenario_of
from benchmarks.row import Row, Say

REST, STEP, SINE = 0.3, 0.3, 0.4  # s
STEP_RATE, SINE_HZ = 5.0, 30.0
QUIET = 1_000_000
NOISE_60_DB = 8.8542e-5
EVERY = 16


def tracked(noise_V: float | None, quiet: int, seed: int = 1) -> ClosedLoop:
    """The run; `noise_V` replaces the scenario's noise."""
    rate = {
        "kind": "segments",
        "segment": [
            {"kind": "constant", "duration_s": REST, "rate_rad_s": 0.0},
            {"kind": "constant", "duration_s": STEP, "rate_rad_s": STEP_RATE},
            {"kind": "sine", "duration_s": SINE, "amplitude_rad_s": STEP_RATE, "frequency_Hz": SINE_HZ},
            {"kind": "constant", "rate_rad_s": 0.0},
        ],
    }
    scenario = scenario_of("s-classic", rate=rate, sense={} if noise_V is None else {"noise_V": noise_V})
    bench = bench_of(
        "s-classic",
        device={} if noise_V is None else {"sense": {"noise_V": noise_V}},
        observer={"process_noise": {"rate_rad_s_per_rts": 100.0}},
    )
    samples = round((REST + STEP + SINE) * scenario.board.sample_rate_Hz) + quiet
    return close_loop(scenario, bench, samples, seed=seed, every=EVERY)


def lag(run: ClosedLoop, start: float, stop: float) -> tuple[float, float]:
    """(amplitude of the estimated sine over the true one, its delay in s) by least squares at the known frequency."""
    t = run.tick / run.sample_rate_Hz
    part = (t >= start) & (t < stop)
    angular = 2.0 * math.pi * SINE_HZ
    basis = np.stack([np.sin(angular * t[part]), np.cos(angular * t[part]), np.ones(part.sum())], axis=1)

    def phasor(values: Floats) -> complex:
        a, b, _ = np.linalg.lstsq(basis, values[part], rcond=None)[0]
        return complex(a, b)

    ratio = phasor(run.estimates["rate_rad_s"]) / phasor(run.at("rate_rad_s"))
    return abs(ratio), -math.atan2(ratio.imag, ratio.real) / angular


def study(noise_V: float | None, quiet: int) -> dict[str, float]:
    """All figures of one noise level."""
    run = tracked(noise_V, quiet)
    t = run.tick / run.sample_rate_Hz
    error = run.estimates["rate_rad_s"] - run.at("rate_rad_s")
    angle = run.estimates["angle_rad"] - run.at("angle_rad")
    sine = (t >= REST + STEP + 0.1) & (t < REST + STEP + SINE)
    step = (t >= REST + 0.1) & (t < REST + STEP)
    gain, delay = lag(run, REST + STEP + 0.1, REST + STEP + SINE)
    reached = np.flatnonzero((t >= REST) & (run.estimates["rate_rad_s"] >= 0.9 * STEP_RATE))
    late = t >= REST + STEP + SINE + 0.1
    deviation = run.estimates["sd_kxx_per_s2"] / run.observer.device.target
    return {
        "step: 90 % reached after  / s": float(t[reached[0]] - REST) if reached.size else math.nan,
        "step: mean rate error  / rad/s": float(error[step].mean()),
        "sine: amplitude ratio": gain,
        "sine: delay  / s": delay,
        "sine: rate error rms  / rad/s": rms(error[sine]),
        "sine: angle error rms  / rad": float(np.std(angle[sine])),
        "quiet: rate error rms  / rad/s": rms(error[late]),
        "quiet: largest rate error  / rad/s": float(np.abs(error[late]).max()),
        "quiet: angle drift  / rad": float(np.ptp(angle[late])),
        "quiet: energy, largest deviation": float(np.abs(run.estimates["energy_ratio"][late] - 1.0).max()),
        "quiet: largest stiffness deviation over the first": float(deviation[late].max() / deviation[late][0]),
        "quiet: innovation over its predicted deviation": rms(
            (run.innovation_V / run.innovation_sd_V)[-quiet // 2 :].ravel()
        ),
    }


def rows(say: Say) -> list[Row]:
    """Both noise levels."""
    figures = []
    for label, noise_V in (("amplitude/noise 20", None), ("amplitude/noise 1000", NOISE_60_DB)):
        for what, value in study(noise_V, QUIET).items():
            name, _, unit = what.partition(" / ")
            figures.append(Row(f"{label}, {name}", value, unit or "1"))
        say(label)
    return figures
