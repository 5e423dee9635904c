"""A bench-top gyro, its bench and its motion: what birch.c integrates, how a device is drawn, what a base model leaves.

The motion obeys (2) of Chen & Chi, TW I384198 B1, with Euler and centrifugal force, and laws of birch_laws.py.
"""

import ctypes
import hashlib
import math
import os
import subprocess
import tempfile
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STATES = 16  # NS of birch.c
BURN_IN = 400  # samples before the record begins

# Parameters of birch.c, in its order: it asks by first and last name of a group whether a kind of law is in use.
GROUPS = (
    "kxx kyy kxy dxx dyy dxy phi_x phi_y rate gain_x gain_y amp ts adc dac full_scale latency",
    "rate_amp rate_w rate_phase step0_t step0_d step0_s step1_t step1_d step1_s step2_t step2_d step2_s",
    "step3_t step3_d step3_s warm_ramp warm_amp warm_w",
    "loop_w loop_beta loop_e loop_i loop_max loop_q mod mod_w mod_square virtual",
    "k3x k3y k3 k2x k2y kn stop_k stop_gap",
    "d3x d3y d3r fx fy fax fay dax day dqx dqy dqr dcx dcy dcr v0",
    "bcx bsx bcy bsy ktx kty ktxy dtx dty dtxy base_w pump_k pump_w trap_k trap_w",
    "tlx tly hpx hpy rx ry heat_k wake_c sag_a",
    "mode_w mode_zeta heat_vv heat_tau wake_tau sag_uu sag_tau",
    "hx hy mx my qx qy sx sy limit zx zy band tux tuy tsx tsy",
    "ex ey gy a2x a2y a3x a3y fdx fdy lcx lsx lcy lsy line_w ptx pty",
    "aging_g aging_tau cross_c cross_w clx cly level inl_a inl_w",
)
NAMES = [name for group in GROUPS for name in group.split()]
FITTED = NAMES[:8]  # constants of the base model: with state and rate all that a model without effects can adapt
NOT_ZERO = dict.fromkeys(("heat_vv", "heat_tau", "wake_tau", "sag_uu", "sag_tau", "aging_tau", "cross_w"), 1.0)


@cache
def library() -> ctypes.CDLL:
    """birch.c behind the list of its parameters, compiled once into the temporary folder."""
    enum = "enum {" + ", ".join(f"I_{name}" for name in NAMES) + "};\n"
    text = enum + Path(__file__).with_name("birch.c").read_text("utf-8")
    flags = ["-O2", "-std=c99", "-ffp-contract=off", "-shared", "-fPIC"]
    key = hashlib.sha256((text + " ".join(flags)).encode()).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"gyrohil-birch-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    made = folder / f"{key}.so"
    if not made.exists():
        part = folder / f"{key}.{os.getpid()}"
        command = ["gcc", *flags, "-x", "c", "-", "-o", str(part), "-lm"]
        subprocess.run(command, input=text, text=True, check=True)
        part.replace(made)
    loaded = ctypes.CDLL(str(made))
    pointer, number, real = ctypes.c_void_p, ctypes.c_long, ctypes.c_double
    loaded.birch_run.restype = number
    loaded.birch_run.argtypes = [pointer, number, real, pointer, ctypes.c_int, pointer, pointer, pointer, pointer]
    loaded.birch_law.argtypes = [pointer, real, real, real, pointer, pointer]
    return loaded


def vector(values: dict[str, float]) -> Array:
    """The parameters in the order of birch.c."""
    merged = NOT_ZERO | values
    return np.array([merged.get(name, 0.0) for name in NAMES])


class Runaway(Exception):
    """The motion left all bounds."""


@dataclass
class Motion:
    """Rows of a simulation: readings (n, 2) in V, drives (n, 2) in m/s², states (n, 16) where they were asked for."""

    volts: Array
    drive: Array
    states: Array


def simulate(
    p: Array, n: int, start: Array, t0: float, *, disturb: Array | None = None, drive: Array | None = None
) -> Motion:
    """n rows from time t0 in s and the state `start`; `drive` as given, or made by the laboratory's loop without it.

    `disturb`, (n, 6): force noise x, y in m/s², noise of the reading x, y in V, dither x, y in m/s².
    """
    state, u, volts, states = start.copy(), np.zeros((n, 2)), np.empty((n, 2)), np.empty((n, STATES))
    if drive is not None:
        u[:] = drive
    noise = None if disturb is None else disturb.ctypes.data
    arrays = (state.ctypes.data, u.ctypes.data, volts.ctypes.data, states.ctypes.data)
    if library().birch_run(p.ctypes.data, n, t0, noise, drive is None, *arrays):
        raise Runaway
    return Motion(volts, u, states)


@dataclass
class Device:
    """A device on its bench: parameters of birch.c, how it starts, its noise, and what its data sheet says."""

    values: dict[str, float]  # SI
    samples: int
    start: Array  # state at the beginning of the burn-in
    noise_V: float  # of a reading, rms, quantisation not included
    dither_mps2: float  # rms
    force_density: float  # one-sided, m/s² per √Hz, of the drive amplifier
    bits: int  # of the sense converter
    mass_kg: float
    offset_sd_V: float
    rate_walk: float  # rad/s per √s
    resonances: bool  # whether the data sheet gives resonance and Q, or stiffness and damping
    effects: list[dict[str, Any]] = field(default_factory=list)

    @property
    def frequency_Hz(self) -> float:
        return math.sqrt(0.5 * (self.values["kxx"] + self.values["kyy"])) / (2 * math.pi)

    def floor_V(self, peak_V: float) -> float:
        """Noise of a reading with its quantisation, V, where the converter's range suits a peak in V."""
        step = 2 * 1.15 * peak_V / 2**self.bits
        return math.hypot(self.noise_V, step / math.sqrt(12))

    def run(self, added: dict[str, float], rng: np.random.Generator | None = None) -> Motion:
        """Burn-in and record with the parameters of effects added: with noise drawn from rng, or with dither alone."""
        n = self.samples + BURN_IN
        dither = np.random.default_rng(self.samples).normal(0.0, self.dither_mps2, (n, 2))
        disturb = np.zeros((n, 6))
        disturb[:, 4:] = dither
        if rng is not None:
            ts = self.values["ts"]
            disturb[:, :2] = rng.normal(0.0, self.force_density * math.sqrt(0.5 / ts), (n, 2))
            disturb[:, 2:4] = rng.normal(0.0, self.noise_V, (n, 2))
        return simulate(vector(self.values | added), n, self.start, -BURN_IN * self.values["ts"], disturb=disturb)

    def residual_ratio(self, added: dict[str, float], windows: int = 6, cycles: int = 30) -> float:
        """Residual of the base model over the noise, both rms, in a record with the effects `added`.

        The noiseless record is cut into free runs of the model without effects. Gauss and Newton fit its constants (one
        set for all runs) and state and rate at the start of each (rate beside the true course), as any observer would.
        """
        try:
            motion = self.run(added)
        except Runaway:
            return math.inf
        ts, amplitude = self.values["ts"], self.values["amp"]
        w = 2 * math.pi * self.frequency_Hz
        length = round(cycles / (self.frequency_Hz * ts))
        firsts = np.linspace(BURN_IN + 100, self.samples + BURN_IN - length - 1, windows).astype(int)
        units = np.array([w**2 * 1e-6] * 3 + [w * 1e-6] * 3 + [amplitude * 1e-5] * 2)  # steps of the differences
        own = np.array([amplitude * 1e-6, amplitude * w * 1e-6] * 2 + [w * 1e-6])
        shared, local = np.zeros(len(units)), np.zeros((windows, len(own)))
        scale = np.array([self.values["gain_x"], self.values["gain_y"]])
        floor = self.floor_V(float(np.abs(motion.volts).max()))

        def free_run(i: int, constants: Array, of_run: Array) -> Array:
            values = self.values | {k: self.values[k] + d for k, d in zip(FITTED, constants, strict=True)}
            values["rate"] += of_run[4]
            first = int(firsts[i])
            begin = np.zeros(STATES)
            begin[:4] = motion.states[first, :4] + of_run[:4]
            drive, t0 = motion.drive[first : first + length], (first - BURN_IN) * ts
            displacement: Array = (simulate(vector(values), length, begin, t0, drive=drive).volts / scale).ravel()
            return displacement

        best = math.inf
        try:
            for _ in range(4):
                residuals, left, slopes, bases = [], [], [], []
                for i, first in enumerate(firsts):
                    model = free_run(i, shared, local[i])
                    residual = (motion.volts[first : first + length] / scale).ravel() - model
                    of_shared = [free_run(i, shared + step, local[i]) - model for step in np.diag(units)]
                    of_local = [free_run(i, shared, local[i] + step) - model for step in np.diag(own)]
                    q, r = np.linalg.qr(np.array(of_local).T)  # what the run's own start can make is taken out of all
                    columns = np.array(of_shared).T
                    bases.append((q, r, columns))
                    residuals.append(residual)
                    left.append(residual - q @ (q.T @ residual))
                    slopes.append(columns - q @ (q.T @ columns))
                rms = float(np.sqrt(np.mean(np.square(residuals))))
                converged, best = rms > 0.95 * best, min(rms, best)
                if converged:
                    break
                step = np.linalg.lstsq(np.concatenate(slopes), np.concatenate(left), rcond=1e-9)[0]
                shared = shared + units * step
                for i, (q, r, columns) in enumerate(bases):
                    local[i] += own * np.linalg.lstsq(r, q.T @ (residuals[i] - columns @ step), rcond=1e-9)[0]
        except Runaway:
            pass
        return math.hypot(1.0, best * float(np.abs(scale).min()) / floor)


def draw_device(rng: np.random.Generator, *, excited: bool) -> Device:
    """A device, its bench and its motion; without excitation of one amplitude, no dither, no virtual rotation."""
    frequency, cycle = 10 ** rng.uniform(2.0, 3.0), rng.uniform(15.0, 40.0)
    w, ts, samples = 2 * math.pi * frequency, 1 / round(frequency * cycle), int(rng.integers(60_000, 130_001))
    duration, amplitude, q = (
        samples * ts,
        10 ** rng.uniform(-4.7, -3.0),
        10 ** rng.uniform(math.log10(200), math.log10(2e4)),
    )
    split, cross = 10 ** rng.uniform(-3.5, -1.8), 10 ** rng.uniform(-4.0, -2.3)
    volts = rng.uniform(0.3, 3.0)
    offset = rng.uniform(0.02, 0.15)
    sign = rng.choice([-1.0, 1.0], 4)
    v = {
        "kxx": w**2 * (1 + sign[0] * split / 2),
        "kyy": w**2 * (1 - sign[0] * split / 2),
        "kxy": sign[1] * cross * w**2,
        "dxx": w / q * rng.uniform(0.85, 1.15),
        "dyy": w / q * rng.uniform(0.85, 1.15),
        "dxy": w / q * rng.uniform(-0.15, 0.15),
        "phi_x": sign[2] * amplitude * offset * rng.uniform(0.3, 1.5),
        "phi_y": sign[3] * amplitude * offset * rng.uniform(0.3, 1.5),
        "gain_x": volts / amplitude,
        "gain_y": volts / amplitude * float(rng.choice([1.0, 1.0, 0.8, 1.25])),
        "amp": amplitude,
        "ts": ts,
        "latency": float(rng.integers(0 if rng.random() < 0.2 else 1, 4)),
        "loop_w": w * (1 + rng.normal(0, 0.002)),
        "loop_beta": 1 / (cycle * rng.uniform(0.8, 1.5)),
        "loop_e": rng.uniform(0.015, 0.04),
        "loop_q": rng.uniform(0.02, 0.06) if not excited or rng.random() < 0.75 else 0.0,
    }
    v["loop_i"] = v["loop_e"] / (100 * cycle)
    dither, slow = 0.0, rng.uniform(80, 400)  # cycles of the mass in one of its amplitude
    if excited:
        v |= {"mod": rng.uniform(0.15, 0.4), "mod_w": w / slow, "mod_square": float(rng.random() < 0.3)}
        v["virtual"] = float(rng.choice([-1.0, 1.0])) * rng.uniform(0.5, 4.0)
        dither = w**2 * amplitude * 10 ** rng.uniform(-2.8, -2.2)
    walk = _turntable(rng, v, duration, ["sine", "steps", "both"] if excited else ["rest", "constant", "sine", "steps"])
    if rng.random() < 0.25:
        v |= draw_warmth(rng, duration)
    v["loop_max"] = 1.5 / q + 2.5 * v.get("mod", 0.0) / slow + 0.012
    need = w**2 * amplitude * (v["loop_max"] + split + 2 * abs(v.get("virtual", 0.0)) / w) + 4 * dither
    v["full_scale"] = float(f"{need * rng.uniform(1.2, 2.0):.2g}")
    v["dac"] = 2 * v["full_scale"] / 2 ** int(rng.integers(12, 17))
    noise = volts * 10 ** (-rng.uniform(47, 64) / 20)
    bits = int(rng.integers(12, 17))
    start = np.zeros(STATES)
    angle, phase = rng.uniform(0, math.pi), rng.uniform(0, 2 * math.pi)
    place, speed = amplitude * math.cos(phase), -amplitude * w * math.sin(phase)
    start[:4] = place * math.cos(angle), speed * math.cos(angle), place * math.sin(angle), speed * math.sin(angle)
    start[4:6] = start[0], start[2]
    return Device(
        v,
        samples,
        start,
        noise_V=max(noise, 0.7 * 2.6 * volts / 2**bits),
        dither_mps2=dither,
        force_density=noise / volts * amplitude * w * 10 ** rng.uniform(-2.5, -0.5),
        bits=bits,
        mass_kg=float(f"{10 ** rng.uniform(-5, -2):.3g}"),
        offset_sd_V=float(f"{volts * offset * 1.25:.2g}"),
        rate_walk=walk,
        resonances=bool(rng.random() < 0.5),
    )


def _turntable(rng: np.random.Generator, v: dict[str, float], duration_s: float, courses: list[str]) -> float:
    """Draw the course of the rate into v; the random walk that a bench file declares for it, rad/s per √s."""
    course, walk = rng.choice(courses), 0.02
    v["rate"] = rng.uniform(-1.0, 1.0) if course != "rest" else 0.0
    if course in ("sine", "both"):
        size, hertz = rng.uniform(0.3, 2.5), max(rng.uniform(0.05, 0.5), 1.5 / duration_s)
        v |= {"rate_amp": size, "rate_w": 2 * math.pi * hertz, "rate_phase": rng.uniform(0, 2 * math.pi)}
        walk = size * math.sqrt(4 * hertz)
    if course in ("steps", "both"):
        for i, begin in enumerate(np.sort(rng.uniform(0.05, 0.9, int(rng.integers(2, 5))))):
            size, lasts = rng.uniform(-1.5, 1.5), min(rng.uniform(0.2, 0.6), duration_s / 12)
            v |= {f"step{i}_t": begin * duration_s, f"step{i}_d": lasts, f"step{i}_s": size}
            walk = max(walk, abs(size) / math.sqrt(lasts))
    return walk


def draw_warmth(rng: np.random.Generator, duration_s: float) -> dict[str, float]:
    """A laboratory that warms by a few kelvin while its air conditioning comes and goes."""
    period = duration_s / rng.uniform(1.0, 4.0)
    return {
        "warm_ramp": rng.uniform(1.0, 4.0) / duration_s,
        "warm_amp": rng.uniform(0.3, 1.5),
        "warm_w": 2 * math.pi / period,
    }
