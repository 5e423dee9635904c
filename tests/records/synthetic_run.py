"""A run folder made by formula: a Foucault-like pattern, estimates that converge on it, white innovation.

An undamped isotropic oscillator seen from a frame that turned by φ(t) has the closed form
x + i y = (a cos ωt + i b sin ωt) e^(−iφ); nothing here is integrated.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hil.records.atomic import write_sealed
from hil.records.capture import RowFlag, board_layout
from hil.records.estimates import estimates_layout, innovation_layout
from hil.records.layout import Column, Layout
from hil.records.result import Percentiles, save_result
from hil.records.runfolder import RunFolder
from hil.records.stream import BlockWriter
from hil.records.summary import summarise
from hil.records.timing import timing_layout
from hil.running.recording.recorder import record_here

MASS_KG = 1e-3
OMEGA = 2 * np.pi * 200.0
GAIN_V_PER_M = -890.0
NOISE_V = 89e-6
AMPLITUDE_M = 1e-4
K, D = OMEGA**2, OMEGA / 1000
TRUE = {
    "kxx_per_s2": 1.02 * K,
    "kyy_per_s2": 0.98 * K,
    "kxy_per_s2": 0.01 * K,
    "dxx_per_s": 1.1 * D,
    "dyy_per_s": 0.9 * D,
    "dxy_per_s": 0.02 * D,
}
START = {
    "kxx_per_s2": 0.99 * K,
    "kyy_per_s2": 1.01 * K,
    "kxy_per_s2": 0.0,
    "dxx_per_s": 0.5 * D,
    "dyy_per_s": 0.5 * D,
    "dxy_per_s": 0.0,
}
STATES = ("x_m", "vx_mps", "y_m", "vy_mps", "phi_x_V", "phi_y_V", "rate_rad_s", *TRUE)

BENCH = """\
# an emulated board, as its data sheet declares it
[device]
name = "S-slow"
axes = {axes}
mass_kg = 1e-3
stiffness_N_per_m = [1579.1, 1579.1, 0.0]
damping_N_s_per_m = [1.2566e-3, 1.2566e-3, 0.0]
amplitude_m = 100e-6
sample_rate_Hz = {rate:g}
normalised = {normalised}

[device.sense]
gain_V_per_m = -890.0
noise_V = 89e-6

[loop]
clock = "paced"
duration_s = {seconds:g}
settle_s = {settle:g}

[observer]
variant = "full"
gain = "fading"
memory_s = 2.0
"""


@dataclass(frozen=True)
class Options:
    """What the synthetic run is like."""

    seconds: float = 2.0
    settle_s: float = 0.5
    rate_Hz: float = 4000.0
    every: int = 10
    axes: int = 2
    angle_drift: float = 0.0
    virtual_rotation_rad_s: float = 0.0
    line_V: float = 0.0
    timing: bool = True
    normalised: bool = True
    interrupted: bool = False
    result: bool = True
    seed: int = 1
    first_tick: int = 0
    """Where the board's count of samples stands when the run begins."""
    zeroed: bool = False
    """Whether angles count from a new zero where scoring starts, as those of a run do."""


def pattern(t, phi, rate, quadrature=0.01):
    """True x, ẋ, y, ẏ of the turning ellipse."""
    still = AMPLITUDE_M * (np.cos(OMEGA * t) + 1j * quadrature * np.sin(OMEGA * t))
    moving = AMPLITUDE_M * OMEGA * (-np.sin(OMEGA * t) + 1j * quadrature * np.cos(OMEGA * t))
    turn = np.exp(-1j * phi)
    z, v = still * turn, (moving - 1j * rate * still) * turn
    return z.real, v.real, z.imag, v.imag


def write_run(folder: Path, options: Options = Options()) -> Path:
    """Write the run folder; returns the path of its truth file, which lies outside it."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(options.seed)
    n = int(options.seconds * options.rate_Hz)
    tick = np.arange(n)
    t = tick / options.rate_Hz
    swing = 2 * np.pi * 0.5
    rate = 1.57 + 0.6 * np.sin(swing * t)
    angle = 1.57 * t + 0.6 / swing * (1 - np.cos(swing * t))
    virtual = options.virtual_rotation_rad_s * t
    spin = rate + options.virtual_rotation_rad_s
    x, vx, y, vy = pattern(t, angle + virtual + options.angle_drift * t, spin + options.angle_drift)
    true = {"x_m": x, "vx_mps": vx, "y_m": y, "vy_mps": vy}
    true |= {
        "phi_x_V": np.full(n, 9e-3),
        "phi_y_V": np.full(n, -6e-3),
        "rate_rad_s": rate,
        "angle_rad": angle,
    }
    bench = BENCH.format(
        axes=options.axes,
        rate=options.rate_Hz,
        seconds=options.seconds,
        settle=options.settle_s,
        normalised=str(options.normalised).lower(),
    )
    write_sealed(folder / "bench.toml", bench)
    layouts, rows = _records(options, rng, tick, t, true)
    for values in rows.values():
        values["tick"] += options.first_tick
    recording = record_here(folder, layouts)
    for stem, values in rows.items():
        recording[stem].push(values)
    recording.__exit__(*((KeyboardInterrupt, None, None) if options.interrupted else (None, None, None)))
    if options.result:
        _write_result(folder)
    truth = folder.parent / f"{folder.name}-truth.arrow"
    codes = {name: rows["capture"][name] for name in rows["capture"].dtype.names if name.endswith("_code")}
    write_truth(truth, tick + options.first_tick, true | codes, options)
    return truth


def write_truth(path: Path, tick, true, options: Options = Options()) -> None:
    """Write a truth file as the emulator does."""
    about = {
        "every": 1,
        "mass_kg": MASS_KG,
        "stiffness_per_s2": [TRUE[name] for name in ("kxx_per_s2", "kyy_per_s2", "kxy_per_s2")],
        "damping_per_s": [TRUE[name] for name in ("dxx_per_s", "dyy_per_s", "dxy_per_s")],
        "sense_gain_V_per_m": [GAIN_V_PER_M, GAIN_V_PER_M],
        "noise_V": NOISE_V,
        "seed": options.seed,
        "sample_rate_Hz": options.rate_Hz,
        "effects": [],
    }
    write_truth_columns(path, {"tick": tick, **true}, about)


def write_truth_columns(path: Path, columns, about) -> None:
    """A truth file of these columns, `tick` first, that says this of itself."""
    types = {name: "i8" if name == "tick" else values.dtype.str[1:] for name, values in columns.items()}
    own = {key: value for key, value in about.items() if key not in ("kind", "version", "columns", "checksum")}
    layout = Layout("truth", tuple(Column(name, type_) for name, type_ in types.items()), 1000, own)
    rows = np.empty(len(columns["tick"]), layout.dtype)
    for name, values in columns.items():
        rows[name] = values
    with BlockWriter(path, layout) as file:
        file.push(rows)


def _records(options, rng, tick, t, true):
    n, axes = tick.size, options.axes
    states = STATES if axes == 2 else ("x_m", "vx_mps", "phi_x_V", "kxx_per_s2", "dxx_per_s", "drive_gain_x")
    layouts = {
        "capture": board_layout(
            tick_rate_Hz=options.rate_Hz,
            axes=axes,
            latency_ticks=1,
            sense_scale_V=0.25 / 2**15,
            drive_scale=10 / 2**15,
            identity={"protocol": 1, "unique_id": "00000000000000a1", "firmware": 1},
        ),
        "innovation": innovation_layout(tick_rate_Hz=options.rate_Hz, axes=axes),
        "estimates": estimates_layout(
            states,
            tick_rate_Hz=options.rate_Hz,
            every=options.every,
            angle=axes == 2,
            header={
                "target_stiffness_per_s2": K,
                "virtual_rotation_rad_s": options.virtual_rotation_rad_s,
                "mass_kg": MASS_KG,
                **({"angle_zero_after_s": options.settle_s} if options.zeroed else {}),
            },
        ),
    }
    capture = np.zeros(n, layouts["capture"].dtype)
    innovation = np.zeros(n, layouts["innovation"].dtype)
    capture["tick"] = innovation["tick"] = tick
    for axis in "xy"[:axes]:
        volts = GAIN_V_PER_M * true[f"{axis}_m"] + true[f"phi_{axis}_V"] + NOISE_V * rng.standard_normal(n)
        capture[f"v{axis}_code"] = np.rint(volts / (0.25 / 2**15))
        capture[f"u{axis}_code"] = np.rint(1.6e-2 * true[f"{axis}_m"] * K / (10 / 2**15))
        sd = NOISE_V * (1 + 3 * np.exp(-t / 0.1))
        line = options.line_V * np.sin(3 * OMEGA * t)
        innovation[f"nu_{axis}_V"] = sd * rng.standard_normal(n) + line
        innovation[f"s_{axis}_V"] = sd
    capture["flags"][n // 3 :: max(n // 5, 1)] = RowFlag.LATE_ANSWER_HELD
    rows = {"capture": capture, "innovation": innovation}
    rows["estimates"] = _estimates(options, rng, layouts["estimates"].dtype, states, tick, t, true)
    if options.timing:
        layouts["timing"] = timing_layout(tick_rate_Hz=options.rate_Hz, deadline_us=1e6 / options.rate_Hz)
        timing = np.zeros(n, layouts["timing"].dtype)
        timing["tick"] = tick
        timing["t_receive_ns"] = 10**15 + (t * 1e9).astype(np.int64)
        turnaround_us = np.exp(rng.normal(np.log(38), 0.18, n)) + (rng.random(n) < 0.004) * rng.exponential(180, n)
        timing["t_send_ns"] = timing["t_receive_ns"] + (turnaround_us * 1e3).astype(np.int64)
        rows["timing"] = timing
    return layouts, rows


def _estimates(options, rng, dtype, states, tick, t, true):
    chosen = slice(None, None, options.every)
    m = tick[chosen].size
    start, late = np.exp(-t[chosen] / 0.12), 1e-5 * np.ones(m)
    rows = np.zeros(m, dtype)
    rows["tick"] = tick[chosen]
    wander = np.cumsum(rng.standard_normal((m, len(states))), 0) / np.sqrt(m)
    for column, name in enumerate(states):
        if name in TRUE:
            first, scale = START[name], (K if name.startswith("k") else D)
            sd = scale * (0.02 * start + late * (1 if name.startswith("k") else 300))
            rows[name] = TRUE[name] + (first - TRUE[name]) * start + sd * wander[:, column] * 0.6
        elif name == "drive_gain_x":
            sd = 0.05 * start + late
            rows[name] = 1.0 + sd * wander[:, column]
        else:
            scale = {"x_m": 2e-7, "y_m": 2e-7, "phi_x_V": 2e-5, "phi_y_V": 2e-5, "rate_rad_s": 4e-3}.get(name, 3e-4)
            sd = scale * (0.2 + 5 * start)
            rows[name] = true[name][chosen] + sd * rng.standard_normal(m)
        rows[f"sd_{name}"] = sd
    if options.axes == 2:
        error = 2e-4 * rng.standard_normal(m) + options.angle_drift * t[chosen]
        rows["angle_rad"] = 0.3 + true["angle_rad"][chosen] + error
        rows["angle_sd_rad"] = 2e-4
        rows["angle_u_rad"] = np.hypot(2e-4, 1e-4 * t[chosen])
        rows["angle_forced_rad"] = options.virtual_rotation_rad_s * t[chosen]
        rows["angle_pattern_rad"] = rows["angle_rad"]
        rows["angle_plain_rad"] = rows["angle_rad"] + 6e-4 * np.sin(2 * OMEGA * t[chosen] + 3 * t[chosen])
        rows["angle_rate_integral_rad"] = true["angle_rad"][chosen] + 1e-3 * t[chosen]
        rows["energy_ratio"] = 1 + 0.05 * start + 1e-3 * rng.standard_normal(m)
        rows["quadrature_ratio"] = 0.02 + 0.1 * start + 1e-3 * rng.standard_normal(m)
        rows["valid"] = t[chosen] > 0.05
        if options.zeroed:
            scored = t[chosen] >= options.settle_s
            rows["angle_rad"][scored] -= rows["angle_rad"][scored][0]
    return rows


def _write_result(folder):
    result = summarise(RunFolder(folder)).model_copy(
        update={
            "link": "pty:s-slow.scenario.toml",
            "clock": "paced",
            "bare_turnaround_us": Percentiles(p50=24.0, p99=61.0, p999=140.0),
            "verdict": "good",
            "counters": {"bad_frames": 0, "lost_seq": 0, "saturated": 0, "watchdog_trips": 0, "re_armed": 0},
            "versions": {"gyrohil": "0.1.0", "python": "3.11.7", "numpy": np.__version__},
            "serial_number": "00000000000000a1",
        }
    )
    save_result(folder / "result.json", result)
