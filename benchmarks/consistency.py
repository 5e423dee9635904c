"""Does the EKF know how wrong it is?  S-slow and S-classic, 400 seeds each, no fading, initial values drawn from P0.

At the end of each record: for each of the 13 states whether its 95 % interval holds the truth; the normalised
estimation error squared (NEES) of all 13, whose mean over the records must lie in the 95 % band of χ²; the errors of
rate and pattern angle beside the posterior Cramér–Rao bound of the same records, that is the covariance recursion
linearised along the true trajectory (Tichavský, Muravchik & Nehorai, IEEE Trans. Signal Process. 46(5), 1998, with the
expectation over the records), and the ratio of root mean squares with a bootstrap interval over the records.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.stats import chi2

from benchmarks.lockstep import ClosedLoop, Floats, bench_of, close_loop, scenario_of
from benchmarks.row import Row, Say
from device_emulator.device import Device
from device_emulator.scenario import Scenario
from estimator.observer import Observer
from hil.bench import Bench, override
from hil.inputs.declared import device_of, observer_settings_of

SCENARIOS = ("s-slow", "s-classic")
SEEDS = 400
SAMPLES = 4000
RATE = 1.0
BOLTZMANN = 1.380649e-23


@dataclass(frozen=True)
class End:
    """Errors and predicted deviations (13,) at the end of a record; NEES; [rate, angle] errors and bounds (2,)."""

    error: Floats
    deviation: Floats
    nees: float
    rate_angle_error: Floats
    rate_angle_bound: Floats


def declared_bench(name: str) -> tuple[Scenario, Bench]:
    """Constant rate and white noise only; a bench whose noise is the emulator's, and whose P0 the initial values are
    drawn from.
    """
    scenario = scenario_of(name, rate={"kind": "constant", "rate_rad_s": RATE})
    truth, sense = scenario.truth, scenario.sense
    step = 1.0 / scenario.board.sample_rate_Hz
    quantum = 2.0 * sense.adc_full_scale_V / 2**sense.adc_bits
    damping = sum(truth.damping_N_s_per_m[:2]) / 2.0
    brownian = math.sqrt(4.0 * BOLTZMANN * truth.temperature_K * damping) / truth.mass_kg
    bench = bench_of(
        name,
        device={
            "damping_N_s_per_m": list(truth.damping_N_s_per_m),
            "sense": {"noise_V": math.hypot(sense.noise_V, quantum / math.sqrt(12.0))},
        },
        observer={
            "gain": "ekf",
            "acquisition_s": 400 * step,
            "initial_sd": {"rate_rad_s": 2.0, "stiffness": 0.02, "damping": 0.5},
            "process_noise": {
                "force_mps2_per_rtHz": math.hypot(brownian, scenario.drive.noise_mps2_per_rtHz),
                "rate_rad_s_per_rts": 0.0,
            },
        },
    )
    return scenario, bench


def true_start(scenario: Scenario) -> Floats:
    """The 13 true states one sample before the first row, where the observer starts."""
    truth = scenario.truth
    kxx, kyy, kxy = (k / truth.mass_kg for k in truth.stiffness_N_per_m)
    dxx, dyy, dxy = (d / truth.mass_kg for d in truth.damping_N_s_per_m)
    w = RATE
    a = np.array(
        [[0, 1, 0, 0], [w * w - kxx, -dxx, -kxy, 2 * w - dxy], [0, 0, 0, 1], [-kxy, -dxy - 2 * w, w * w - kyy, -dyy]]
    )
    (x, y), (vx, vy) = truth.position_m, truth.velocity_mps
    motion = expm(-a / scenario.board.sample_rate_Hz) @ np.array([x, vx, y, vy])
    rows: list[Floats] = []
    device = Device(scenario, 0, lambda _, page: rows.append(page.copy()))
    device.rows(np.zeros((1, 2), np.int32))
    device.close()
    offsets = rows[0][0, 4:6]
    return np.concatenate([motion, offsets, [w, kxx, kyy, kxy, dxx, dyy, dxy]])


def with_drawn_initial_values(bench: Bench, truth: Floats, seed: int) -> Bench:
    """The bench with initial values drawn around the truth with the spread the bench declares."""
    observer = Observer(device_of(bench), observer_settings_of(bench))
    draw = truth + np.sqrt(np.diag(observer.covariance)) * np.random.default_rng(seed).standard_normal(13)
    mass = bench.device.mass_kg
    initial = {
        "position_m": [draw[0], draw[2]],
        "velocity_mps": [draw[1], draw[3]],
        "offset_V": [draw[4], draw[5]],
        "rate_rad_s": draw[6],
        "stiffness_N_per_m": list(draw[7:10] * mass),
        "damping_N_s_per_m": list(draw[10:13] * mass),
    }
    return override(bench, {"observer": {"initial": initial}}, "draw")


def pattern_angle(motion: Floats, k: float) -> float:
    """Formula (11)."""
    x, vx, y, vy = motion
    return 0.5 * math.atan2(2.0 * (k * x * y + vx * vy), k * (x * x - y * y) + vx * vx - vy * vy)


def angle_gradient(motion: Floats, k: float) -> Floats:
    """∂θ/∂(x, ẋ, y, ẏ) of (11)."""
    x, vx, y, vy = motion
    s, c = 2.0 * (k * x * y + vx * vy), k * (x * x - y * y) + vx * vx - vy * vy
    ds, dc = 2.0 * np.array([k * y, vy, k * x, vx]), 2.0 * np.array([k * x, vx, -k * y, -vy])
    return np.asarray(0.5 * (c * ds - s * dc) / (s * s + c * c))


def bound(run: ClosedLoop, bench: Bench, start: Floats) -> Floats:
    """Covariance bound (13, 13) at the end of the record."""
    columns = ("x_m", "vx_mps", "y_m", "vy_mps", "phi_x_V", "phi_y_V", "rate_rad_s")
    n = len(run.capture)
    true = np.empty((n, 13))
    true[0] = start
    true[1:, :7] = np.stack([run.truth[name][: n - 1] for name in columns], axis=1)
    true[1:, 7:] = start[7:]
    codes = run.capture[:, 1:5].astype(float)
    identity_scale = run.observer.drive_quantum
    observer = Observer(device_of(bench), observer_settings_of(bench))
    observer.run(np.zeros((n, 2)), codes[:, 2:] * identity_scale, every=n, truth=true)
    return observer.covariance


def end_of(scenario: Scenario, bench: Bench, start: Floats, seed: int) -> End:
    """One record."""
    bench = with_drawn_initial_values(bench, start, seed)
    run = close_loop(scenario, bench, SAMPLES, seed=seed, every=SAMPLES)
    true = np.concatenate(
        [
            [run.at(name)[-1] for name in ("x_m", "vx_mps", "y_m", "vy_mps", "phi_x_V", "phi_y_V", "rate_rad_s")],
            start[7:],
        ]
    )
    state, covariance = run.observer.state, run.observer.covariance
    deviation = np.sqrt(np.diag(covariance))
    normal = (state - true) / deviation
    limit = bound(run, bench, start)
    k = run.observer.device.target
    gradient = angle_gradient(true[:4], k)
    angle_error = pattern_angle(state[:4], k) - pattern_angle(true[:4], k)
    return End(
        error=state - true,
        deviation=deviation,
        nees=float(normal @ np.linalg.solve(covariance / np.outer(deviation, deviation), normal)),
        rate_angle_error=np.array([state[6] - true[6], (angle_error + math.pi / 2) % math.pi - math.pi / 2]),
        rate_angle_bound=np.array([limit[6, 6], gradient @ limit[:4, :4] @ gradient]),
    )


def bootstrap(errors: Floats, bounds: Floats, draws: int = 2000) -> tuple[float, float, float]:
    """(rms error over rms bound, its 95 % interval by resampling the records)."""
    generator = np.random.default_rng(0)
    index = generator.integers(0, len(errors), (draws, len(errors)))
    ratios = np.sqrt((errors[index] ** 2).mean(1) / bounds[index].mean(1))
    low, high = np.percentile(ratios, (2.5, 97.5))
    return math.sqrt(float((errors**2).mean() / bounds.mean())), float(low), float(high)


def study(name: str, seeds: int, say: Say) -> dict[str, float]:
    """All figures of one scenario."""
    scenario, bench = declared_bench(name)
    start = true_start(scenario)
    ends = []
    for seed in range(seeds):
        ends.append(end_of(scenario, bench, start, seed))
        if seed % 100 == 99:
            say(f"{name}: {seed + 1} records")
    figures = {}
    names = Observer(device_of(bench), observer_settings_of(bench)).model.names
    inside = np.abs([end.error / end.deviation for end in ends]) < 1.959964
    for i, state in enumerate(names):
        figures[f"coverage {state}"] = float(inside[:, i].mean())
    figures["NEES / 13"] = float(np.mean([end.nees for end in ends])) / 13.0
    low, high = chi2.ppf((0.025, 0.975), 13 * seeds) / (13.0 * seeds)
    figures["NEES / 13 band low"], figures["NEES / 13 band high"] = float(low), float(high)
    for i, what in enumerate(("rate", "angle")):
        errors = np.array([end.rate_angle_error[i] for end in ends])
        bounds = np.array([end.rate_angle_bound[i] for end in ends])
        ratio, low, high = bootstrap(errors, bounds)
        figures[f"{what} error / bound"] = ratio
        figures[f"{what} error / bound low"], figures[f"{what} error / bound high"] = low, high
    return figures


def rows(say: Say) -> list[Row]:
    """All figures of both scenarios."""
    figures = []
    for name in SCENARIOS:
        found = study(name, SEEDS, say)
        figures += [Row(f"{name}, {what}", value, "1") for what, value in found.items()]
    return figures
