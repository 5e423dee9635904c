"""A little plant of its own for the estimator's tests, and the loop closed around it in lockstep.

The plant is equation (2) with Ω² and Ω̇ terms by Runge–Kutta at 16 sub-steps a sample (frequency error 1e-9 at 20
samples a cycle); it shares nothing with the estimator's flow.
"""

import ctypes
import hashlib
import math
import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.core.compiler import WARNINGS, compile_library
from estimator.observer import Observer
from estimator.settings import ControllerSettings, Device, ObserverSettings

Array = NDArray[np.float64]


@cache
def _plant() -> Any:
    """The plant in C, compiled when the first test asks for it and kept by its content."""
    source = Path(__file__).with_name("gyro_plant.c")
    digest = hashlib.sha256(source.read_bytes()).hexdigest()[:16]
    library = Path(tempfile.gettempdir()) / f"gyrohil-plant-{digest}.so"
    if not library.exists():
        compile_library([source], library, WARNINGS)
    swing = ctypes.CDLL(str(library)).swing
    swing.argtypes = (*(ctypes.c_void_p,) * 3, *(ctypes.c_double,) * 3)
    swing.restype = None
    return swing


def swing(s: Array, p: Array, ux: float, uy: float, rate_from: float, rate_to: float, h: float) -> None:
    """Move s (4,) over one sample; p = (kxx, kyy, kxy, dxx, dyy, dxy), force held, rate linear in time."""
    assert s.flags.c_contiguous
    p = np.ascontiguousarray(p, dtype=float)
    u = np.array([ux, uy], dtype=float)
    _plant()(s.ctypes.data, p.ctypes.data, u.ctypes.data, rate_from, rate_to, h)


def free_motion(rate: float, kxx: float, kyy: float, kxy: float, dxx: float, dyy: float, dxy: float) -> Array:
    """(4, 4): d/dt of (x, ẋ, y, ẏ) at a constant rate without force."""
    return np.array([
        [0, 1, 0, 0],
        [rate**2 - kxx, -dxx, -kxy, 2 * rate - dxy],
        [0, 0, 0, 1],
        [-kxy, -dxy - 2 * rate, rate**2 - kyy, -dyy],
    ])  # fmt: skip


ANGLES = ("angle", "angle_pattern", "angle_plain", "angle_rate_integral", "energy_ratio", "quadrature_ratio")


@dataclass(frozen=True)
class Truth:
    """What the device really is: S-slow unless said otherwise (SI, per unit mass)."""

    sample_rate: float = 4000.0
    omega0: float = 2 * math.pi * 200.0
    amplitude: float = 1e-4
    stiffness: tuple[float, float, float] = (1.02, 0.98, 0.01)  # of ω0²
    damping: tuple[float, float, float] = (1.1e-3, 0.9e-3, 0.05e-3)  # of ω0
    sense_gain: float = -890.0
    offset: tuple[float, float] = (8.9e-3, -8.9e-3)
    noise: float = 8.9e-5
    force_noise: float = 0.0  # m/s²/√Hz, one-sided
    sense_quantum: float = 0.25 / 32768
    force_quantum: float = 10.0 / 32768
    force_limit: float = 10.0
    latency: int = 1
    # Motion one interval before the first sample, in A and Aω0: that is when an observer's initial values hold.
    start: tuple[float, float, float, float] = (math.cos(0.3), 0.0, math.sin(0.3), 0.0)

    @property
    def parameters(self) -> Array:
        """(kxx, kyy, kxy, dxx, dyy, dxy) in SI."""
        return np.concatenate([np.array(self.stiffness) * self.omega0**2, np.array(self.damping) * self.omega0])

    def device(self, *, stiffness: float = 1.0, damping: float = 1.0, **changes: object) -> Device:
        """The data sheet, its stiffness and damping so many times the truth (kxx up, kyy down)."""
        kxx, kyy, kxy, dxx, dyy, dxy = self.parameters
        declared = Device(
            sample_rate=self.sample_rate,
            stiffness=(kxx * stiffness, kyy * (2.0 - stiffness), kxy if stiffness == 1.0 else 0.0),
            damping=(dxx * damping, dyy * damping, dxy if damping == 1.0 else 0.0),
            amplitude=self.amplitude,
            sense_gain=(self.sense_gain,) * 2,
            noise=(self.noise,) * 2,
            target_stiffness=self.omega0**2,
        )
        return replace(declared, **changes)

    def controller(self, **changes: object) -> ControllerSettings:
        """Control law with the holds and virtual rotation of the tests."""
        usual: dict[str, object] = {
            "latency": self.latency,
            "force_quantum": self.force_quantum,
            "force_limit": self.force_limit,
            "sense_quantum": self.sense_quantum,
            "quadrature_gain": 0.003,
            "virtual_rotation": 5e-3 * self.omega0,
        }
        return ControllerSettings(**(usual | changes))


@dataclass
class Record:
    """What a loop left behind, SI: truth, estimates and what went over the wire, sample by sample."""

    rate: Array  # (n,) true rate [rad/s]
    turned: Array  # (n,) ∫Ω dt [rad]
    motion: Array  # (n, 4) true x, ẋ, y, ẏ at the sample
    sense: Array  # (n, 2) volts as coded
    drive: Array  # (n, 2) m/s² over the interval that ends at the sample
    x: Array  # (n, 13) estimates
    ratio: Array  # (n, 2) innovation over the deviation predicted
    residual: Array  # (n, 2) innovation over the sense noise
    angle: Array
    angle_pattern: Array
    angle_plain: Array
    angle_rate_integral: Array
    energy: Array
    quadrature: Array


def close_loop(
    observer: Observer,
    truth: Truth,
    samples: int,
    rate: float | Array = 0.0,
    *,
    seed: int = 0,
    acquire: int = 400,
    lost: float = 0.0,
    late: float = 0.0,
    safe: slice = slice(0),
) -> Record:
    """Run observer and plant against each other in lockstep.

    Control comes on after `acquire` samples; rate [rad/s] constant or (samples + 1,), linear between samples; shares
    `lost` of the samples do not arrive, `late` of the commands come late (the board holds the last); in the samples
    `safe` the board applies no force.
    """
    rng = np.random.default_rng(seed)
    n, h, p = samples, 1.0 / truth.sample_rate, truth.parameters
    rates = np.full(n + 1, rate) if np.ndim(rate) == 0 else np.asarray(rate, dtype=float)
    scale = truth.amplitude * np.array([1.0, truth.omega0, 1.0, truth.omega0])
    s = np.array(truth.start) * scale
    swing(s, p, 0.0, 0.0, rates[0], rates[0], h)
    noise = rng.standard_normal((n, 2)) * truth.noise
    kicks = rng.standard_normal((n, 2)) * truth.force_noise * math.sqrt(h / 2.0)
    volts = np.abs([observer.scaling.sense(0), observer.scaling.sense(1)])
    row = observer.newest
    motion, x, out = np.zeros((n, 4)), np.zeros((n, len(observer.x))), np.zeros((n, 10))
    sense, drive = np.zeros((n, 2)), np.zeros((n, 2))
    missing, held = rng.random(n) < lost, rng.random(n) < late
    at_zero = np.zeros(n, dtype=bool)
    at_zero[safe] = True
    queue = [(0, 0)] * truth.latency
    acting = (0, 0)
    observer.enable_control(acquire == 0)
    for m in range(n):
        if m == acquire:
            observer.enable_control(True)
        motion[m] = s
        codes = np.rint((truth.sense_gain * s[[0, 2]] + truth.offset + noise[m]) / truth.sense_quantum)
        if missing[m]:
            codes[:] = np.nan
        command = observer.tick(codes[0], codes[1], acting[0], acting[1])
        sense[m] = codes * truth.sense_quantum
        drive[m] = acting[0] * truth.force_quantum, acting[1] * truth.force_quantum
        x[m] = observer.x
        nu, variance = row["nu"], row["s"]
        out[m, :2] = nu / np.sqrt(variance)
        out[m, 2:4] = nu * volts / truth.noise
        out[m, 4:] = [row[name] for name in ANGLES]
        queue.append(command)
        due = queue.pop(0)
        acting = (0, 0) if at_zero[m] else acting if held[m] else due
        ux, uy = acting[0] * truth.force_quantum, acting[1] * truth.force_quantum
        swing(s, p, ux, uy, rates[m], rates[m + 1], h)
        s[[1, 3]] += kicks[m]
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (rates[:-1] + rates[1:]) * h)])[:n]
    return Record(
        rates[:n], turned, motion, sense, drive, x * observer.factors, out[:, :2], out[:, 2:4], *out[:, 4:].T
    )  # fmt: skip


def observer_of(
    truth: Truth, settings: ObserverSettings, *, stiffness: float = 1.03, damping: float = 0.5, **control: object
) -> Observer:
    """An observer with controller whose initial values are off by those factors."""
    return Observer(truth.device(stiffness=stiffness, damping=damping), settings, truth.controller(**control))


def true_angle(record: Record, truth: Truth, virtual: float) -> Array:
    """−(θ − θ0) of the true state by the corrected formula, and without the imposed rotation (n,)."""
    w = record.rate + virtual
    x, vx, y, vy = record.motion.T
    vx, vy = vx - w * y, vy + w * x
    k = truth.omega0**2 + w**2 - record.rate**2
    double = np.arctan2(2.0 * (k * x * y + vx * vy), k * (x**2 - y**2) + vx**2 - vy**2)
    theta = np.unwrap(0.5 * double, period=np.pi)
    return theta[0] - theta - virtual * np.arange(len(theta)) / truth.sample_rate


def slope(record: Record, angle: Array, skip: int) -> float:
    """Angle per rotation, least squares over the record after `skip` samples."""
    return float(np.polyfit(record.turned[skip:], angle[skip:], 1)[0])


def troubled(truth: Truth) -> Record:
    """600 samples of a closed loop, samples of one axis and of both lost, the rate jumping."""
    jump = np.where(np.arange(601) < 300, 1.5, 31.5)
    made = close_loop(observer_of(truth, ObserverSettings(), dither=0.3), truth, 600, jump, acquire=200)
    made.sense[320:325] = np.nan
    made.sense[400, 0] = np.nan
    made.sense[410:412, 1] = np.nan
    return made


def ideal_states(truth: Truth, rate: float, n: int) -> Array:
    """True state vectors (n, 13) of the ideal device of that truth, swinging along a line on a board that turns."""
    w = math.sqrt(truth.omega0**2 + rate**2)
    t = np.arange(n) / truth.sample_rate
    turned = np.exp(-1j * rate * t) * truth.amplitude
    z, dz = turned * np.cos(w * t), turned * (-1j * rate * np.cos(w * t) - w * np.sin(w * t))
    states = np.zeros((n, 13))
    states[:, :4] = np.column_stack([z.real, dz.real, z.imag, dz.imag])
    states[:, 6], states[:, 7:] = rate, truth.parameters
    return states
