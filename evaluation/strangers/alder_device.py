"""A device of `alder`: how it is drawn, and its record, by the plant and loop of alder.c."""

from __future__ import annotations

import ctypes
import hashlib
import math
import os
import subprocess
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from evaluation.strangers.alder_effects import COEFFICIENTS, EFFECTS, laws

Array = NDArray[np.float64]
Chosen = dict[str, dict[str, float]]  # coefficients by effect

STATES, COLUMNS = 14, 10
CONFIG = (
    *("Ts", "A", "w0", "tux", "tuy", "tsx", "tsy", "slew", "Gx", "Gy", "offset_x", "offset_y", "adc_lsb", "adc_range"),
    *("dac_lsb", "full_scale", "latency", "block", "armed", "l1", "l2", "l3", "energy_gain", "quadrature_gain"),
    *("virtual_rotation", "reversal", "modulation", "modulation_Hz", "square"),
    *("trim_kxx", "trim_kyy", "trim_kxy", "trim_dxx", "trim_dyy", "trim_dxy"),
)
FORCE_NOISE = (
    4 * 1.380649e-23 * 300
)  # 4 kB T [J], times damping over mass: one-sided density of (m/s²)², Nyquist's theorem


@cache
def kernel() -> ctypes.CDLL:
    """The compiled plant and loop, from a cache of this user in the temp directory."""
    text = Path(__file__).with_name("alder.c").read_text()
    for mark, put in (("CONFIG", ", ".join(CONFIG)), ("FORCES", laws("force")), ("SENSES", laws("sense"))):
        text = text.replace(f"@{mark}@", put)
    folder = Path(tempfile.gettempdir()) / f"gyrohil-alder-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    library = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:16]}.so"
    if not library.exists():
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            source, built = Path(scratch) / "alder.c", Path(scratch) / "alder.so"
            source.write_text(text)
            flags = ["-O3", "-ffp-contract=off", "-std=c99", "-D_GNU_SOURCE", "-shared", "-fPIC"]
            subprocess.run(["gcc", *flags, "-o", str(built), str(source), "-lm"], check=True)
            built.replace(library)
    return ctypes.CDLL(str(library))


def pointers(arrays: Iterable[NDArray[Any] | None]) -> list[ctypes.c_void_p | None]:
    """Addresses of contiguous arrays, for the kernel."""
    return [None if a is None else ctypes.c_void_p(a.ctypes.data) for a in arrays]


@dataclass
class Device:
    """A device with its chip and its bench, SI; per unit mass where not said otherwise."""

    rng: np.random.Generator
    f: float  # Hz
    A: float  # m
    mass: float  # kg
    base: Array  # kxx kyy kxy dxx dyy dxy
    noise: float  # V, of a sample, without the converter's
    config: dict[str, float]
    dither: float  # m/s², size of the chips of a pseudorandom sequence
    samples: int
    rate: Array  # rad/s at the samples and one before
    warm: Array  # K over the first reading, likewise
    single_tone: bool
    start_deg: float
    steps: float  # rad/s per √s, how fast the rate goes
    U: float = 0.0  # largest drive
    u: float = 0.0  # its rms
    w0: float = field(init=False)
    k: float = field(init=False)
    Ts: float = field(init=False)
    peak: float = field(init=False)

    def __post_init__(self) -> None:
        self.w0, self.Ts = self.config["w0"], self.config["Ts"]
        self.k, self.peak = self.w0**2, self.A * (1 + self.config["modulation"])

    @property
    def noise_all(self) -> float:
        """Rms noise of a sample with that of the converter [V]."""
        return math.hypot(self.noise, self.config["adc_lsb"] / math.sqrt(12))


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between two, evenly in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def rate_profile(rng: np.random.Generator, n: int, T: float, largest: float) -> tuple[Array, float]:
    """Rate [rad/s] of a table that steps, as fast as its motor can, and sways; and ΔΩ/√time of its fastest change."""
    t = np.linspace(0, T, n + 1)
    rate, fastest = np.full(n + 1, rng.uniform(-1, 1) * largest / 2), 0.0
    for _ in range(int(rng.integers(1, 5))):
        step, ramp, at = rng.uniform(-1, 1) * largest, rng.uniform(0.06, 0.25) * T, rng.uniform(0, 0.8) * T
        s = np.clip((t - at) / ramp, 0, 1)
        rate += step * s * s * (3 - 2 * s)
        fastest = max(fastest, abs(step) / math.sqrt(ramp))
    if rng.random() < 0.5:
        cycles, sway = rng.uniform(1, 4), rng.uniform(0.1, 0.5) * largest
        rate += sway * np.sin(2 * np.pi * cycles * t / T + rng.uniform(0, 6))
        fastest = max(fastest, 2 * sway / math.sqrt(T / cycles / 2))
    return rate, fastest


def filter_gains(wt: float) -> tuple[float, float, float]:
    """Stationary gains of the chip's filter, of a rotation by wt a sample beside a constant; it settles in cycles."""
    c, s = math.cos(wt), math.sin(wt)
    F, H = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), np.array([[1.0, 0, 1]])
    P = solve_discrete_are(F.T, H.T, np.diag([4e-3, 4e-3, 1e-5]), np.eye(1))
    gain = (P @ H.T / (H @ P @ H.T + 1)).ravel()
    return float(gain[0]), float(gain[1]), float(gain[2])


def draw_device(rng: np.random.Generator, single_tone: bool, slow: bool, drive: bool) -> Device:
    """A device with its loop. `drive`: one that is driven hard, for effects that scale with the drive."""
    low, high = ((100, 600), (600, 2000), (2000, 12000))[0 if slow else int(rng.choice(3, p=[0.12, 0.2, 0.68]))]
    f = between(rng, low, high)
    fs = float(f"{f * rng.uniform(15.5, 39.5):.3g}")
    w0, Ts, n = 2 * math.pi * f, 1 / fs, int(rng.integers(60, 131)) * 1000
    k, T, Q = w0**2, n / fs, between(rng, 200, 20_000)
    A = float(f"{between(rng, 0.8e-6, 4e-6) * max(1.0, (3000 / f) ** 1.2):.2g}")
    mass = float(f"{between(rng, 0.5, 2) * 1e-8 * (1e4 / f) ** 2.2:.2g}")
    split = between(rng, 1e-3 if drive else 1e-4, 6e-2 if drive or rng.random() < 0.3 else 5e-3)
    azimuth, d = rng.uniform(0, np.pi), w0 / Q
    base = (
        np.array([1 + split * math.cos(2 * azimuth), 1 - split * math.cos(2 * azimuth), split * math.sin(2 * azimuth)])
        * k
    )
    mismatch = rng.uniform(-0.2, 0.2, 2)
    base = np.append(base, np.array([1 + mismatch[0], 1 - mismatch[0], mismatch[1]]) * d)
    # One mean frequency, the chip's target: what the factory trimmed is right to some 1e-4 of the stiffness.
    trims = np.append(base[:3] - [k, k, 0], base[3:])
    trims += rng.normal(size=6) * np.array([k, k, k, d, d, d]) * np.array([2e-4, 2e-4, 2e-4, 0.2, 0.2, 0.1])
    gain = float(f"{rng.uniform(0.08, 0.3) / A:.4g}") * (1 if rng.random() < 0.5 else -1)
    noise = between(rng, 1e-4, 4e-3 if rng.random() < 0.8 else 2e-2) * abs(gain) * A
    bits, reach = int(rng.choice([16, 18, 20, 24])), 2.0 ** math.ceil(math.log2(2.2 * abs(gain) * A))
    offsets = rng.uniform(-0.3, 0.3, 2) * abs(gain) * A
    block = int(rng.choice([32, 48, 64, 100]))
    hold = min(0.02, 0.3 / (block * w0 * Ts))
    turns = rng.uniform(0.5, 4) * rng.choice([-1, 1])
    virtual = 0.0 if single_tone or rng.random() < 0.35 else turns * 2 * math.pi / T
    config = dict.fromkeys(CONFIG, 0.0)
    config |= {"Ts": Ts, "A": A, "w0": w0, "Gx": gain, "Gy": gain}
    if rng.random() < 0.4:
        config["Gy"] = float(f"{gain * rng.uniform(0.9, 1.1):.4g}")
    config |= {"offset_x": offsets[0], "offset_y": offsets[1], "adc_lsb": 2 * reach / 2**bits, "adc_range": reach}
    config |= {"full_scale": 0.5 * k * A, "latency": int(rng.integers(0, 4)), "block": block, "armed": 10 * block}
    config |= dict(zip(("l1", "l2", "l3"), filter_gains(w0 * Ts), strict=True))
    config |= {"energy_gain": hold, "quadrature_gain": hold, "virtual_rotation": virtual}
    if virtual and rng.random() < 0.4:
        config["reversal"] = T / rng.uniform(1.5, 6)
    if not single_tone and rng.random() < 0.9:
        config["modulation"] = rng.uniform(0.1, 0.5)
    config |= {"modulation_Hz": f / between(rng, 250, 900), "square": float(rng.random() < 0.3)}
    config |= dict(zip(CONFIG[-6:], map(float, trims), strict=True))
    config["dac_lsb"] = 2 * config["full_scale"] / 2 ** int(rng.choice([14, 16, 18]))
    dither = (
        0.0
        if single_tone or (rng.random() < 0.2 and not drive)
        else between(rng, 1e-3, 6e-3) * (2 if drive else 1) * k * A
    )
    if single_tone:
        rate, steps = np.full(n + 1, rng.uniform(-1, 1) * 6 / T), 0.0
    else:
        rate, steps = rate_profile(rng, n, T, min(rng.uniform(1, 7) / T, 20.0))
    t = np.linspace(0, 1, n + 1)
    warm = (
        rng.uniform(4, 15) * (1 - np.exp(-t / rng.uniform(0.2, 0.6))) + rng.uniform(0.5, 3) * np.sin(9 * t)
        if slow
        else 0 * t
    )
    start = rng.uniform(0, 180)
    device = Device(rng, f, A, mass, base, noise, config, dither, n, rate, warm, single_tone, start, steps)
    tried = simulate(device, {}, 20_000)[2000:]
    device.U, device.u = float(np.abs(tried[:, 2:4]).max()), float(np.sqrt(np.mean(tried[:, 2:4] ** 2)))
    # The amplifiers are chosen for the device: some two thirds of their reach is used, in steps of their own converter.
    scale = float(f"{rng.uniform(1.5, 3) * device.U:.2g}")
    config["full_scale"], config["dac_lsb"] = scale, 2 * scale / 2 ** int(rng.choice([12, 14, 16]))
    return device


def placed(device: Device, chosen: Chosen) -> tuple[NDArray[np.int32], Array, Array, Array, int]:
    """Switches, coefficients, config, start tolerance and number of states, as the kernel takes them."""
    on, numbers = np.zeros(len(EFFECTS), dtype=np.int32), np.zeros((len(EFFECTS), COEFFICIENTS))
    config = dict(device.config)
    for i, (key, effect) in enumerate(EFFECTS.items()):
        if key in chosen:
            on[i], values = 1, [chosen[key][c.symbol] for c in effect.coefficients]
            numbers[i, : len(values)] = values
            if key in ("drive_delay", "sense_delay", "slew"):
                config |= chosen[key]
    states = STATES if any("o[" in EFFECTS[key].force for key in chosen) else 4
    A, w = device.A, device.w0
    lowest = np.array([A, A * w, A, A * w, A, A, A / w, A / w, A, A * w, A, A * w, 1, 1]) * 1e-11
    return on, numbers, np.array([config[name] for name in CONFIG]), lowest, states


def simulate(
    device: Device,
    chosen: Chosen,
    samples: int,
    *,
    base: Array | None = None,
    first: int = 0,
    state: Array | None = None,
    drive: Array | None = None,
    rate: Array | None = None,
    noisy: bool = True,
    coarse: float = 1.0,
) -> Array:
    """Rows (volts 2, drive 2, x vx y vy, displacements shown 2) from row `first` on.

    With `drive` (n, 2) no loop runs; `base` and `rate` stand in place of the device's; `coarse` times the tolerance.
    """
    on, numbers, config, tolerance, states = placed(device, chosen)
    rng = np.random.default_rng([17, int(device.f * 1e6)])
    n, base = samples, device.base if base is None else base
    rate, warm = (device.rate if rate is None else rate)[first:], device.warm[first:]
    noise = force = dither = None
    if noisy:
        noise, force = rng.normal(size=(n, 2)) * device.noise, rng.normal(size=(n, 2))
        force *= math.sqrt(FORCE_NOISE * np.mean(device.base[3:5]) / device.mass / 2 / device.Ts)
        chips = np.repeat(rng.integers(0, 2, (n // 3 + 1, 2)), 3, axis=0)[:n] * 2.0 - 1
        dither = np.ascontiguousarray(chips * device.dither)
    if state is None:
        a, s = math.radians(device.start_deg), np.zeros(STATES)
        s[:4] = device.A * np.array([math.cos(a), 0, math.sin(a), 0])
        s[4:6] = s[[0, 2]]
        state = s
    state, out = np.concatenate([state, np.zeros(STATES - len(state))]), np.empty((n, COLUMNS))
    given = None if drive is None else np.ascontiguousarray(drive)
    rate, warm, tolerance = (np.ascontiguousarray(a) for a in (rate, warm, tolerance * coarse))
    kernel().run(
        *pointers((config, base, on, numbers, tolerance)),
        *(states, ctypes.c_long(n), ctypes.c_double(first * device.Ts)),
        *pointers((rate, warm, force, noise, dither, given, state, out)),
    )
    return out
