"""Emulated boards drawn at random, with what is true of them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

_EPSILON = 8.8541878128e-12
_SCENARIO = """# Drawn: {seed}
seed = {seed}

[truth]
mass_kg = {mass!r}
stiffness_N_per_m = {stiffness!r}
damping_N_s_per_m = {damping!r}
position_m = {position!r}

[sense]
fingers = {fingers!r}
width_m = 2e-5
gap_m = 2e-6
overlap_m = 2e-4
mismatch_m = {mismatch!r}
bias_V = 5.0
feedback_F = {feedback!r}
noise_V = {noise!r}
adc_bits = {adc_bits}
adc_full_scale_V = {full_scale_V!r}

[drive]
dac_bits = 16
full_scale_mps2 = {full_scale!r}
latency_samples = {latency}
noise_mps2_per_rtHz = {drive_noise!r}

[board]
sample_rate_Hz = {rate_Hz!r}
unique_id = {seed}
firmware = 0x00010000

[rate]
kind = "constant"
rate_rad_s = {rate!r}
"""


@dataclass(frozen=True)
class Drawn:
    """A scenario's text, and by key what is true, SI per unit mass; latency in ticks."""

    text: str
    truth: dict[str, float]
    latency: int
    amplitude: float
    snr_dB: float


def draw(seed: int) -> Drawn:
    """A board: 200 Hz to 20 kHz, decay up to 20 s, split, axes askew, latency 1 to 3, offsets, 40 to 80 dB."""
    rng = np.random.default_rng(seed)
    f = float(10.0 ** rng.uniform(np.log10(200.0), np.log10(20e3)))
    rate_Hz = float(np.round(f * rng.uniform(15.0, 40.0)))
    decay = float(10.0 ** rng.uniform(np.log10(max(0.05, 60.0 / f)), np.log10(20.0)))
    split, azimuth = f * 10.0 ** rng.uniform(-4.0, -1.7), rng.uniform(0.0, np.pi)
    stiffness = _turned(np.square(2.0 * np.pi * (f + 0.5 * split * np.array([1.0, -1.0]))), azimuth)
    damping = _turned(2.0 / decay * np.array([1.0, rng.uniform(1.0, 1.5)]), rng.uniform(0.0, np.pi))
    mass = float(10.0 ** rng.uniform(-8.5, -5.0))
    amplitude = float(10.0 ** rng.uniform(-6.0, -4.3))
    snr = float(rng.uniform(40.0, 80.0))
    fingers = rng.integers(80, 120, 2)
    swing = 0.1 * 10.0 ** rng.uniform(-0.5, 0.5)
    feedback = 2.0 * 5.0 * 100.0 * _EPSILON * 10.0 * amplitude / swing
    gains = -2.0 * 5.0 / feedback * fingers * _EPSILON * 10.0
    mismatch = rng.uniform(-0.1, 0.1, 2) * amplitude
    omega = 2.0 * np.pi * f
    rate = float(rng.normal(0.0, 0.02))
    latency = int(rng.integers(1, 4))
    truth = {
        **dict(zip(("kxx", "kyy", "kxy"), stiffness, strict=True)),
        **dict(zip(("dxx", "dyy", "dxy"), damping, strict=True)),
        "rate": rate,
        "gain_x": float(gains[0]),
        "gain_y": float(gains[1]),
        "share_xy": 0.0,
        "share_yx": 0.0,
        "delay": 0.0,
        "offset_x": float(gains[0] * mismatch[0]),
        "offset_y": float(gains[1] * mismatch[1]),
    }
    text = _SCENARIO.format(
        seed=seed, mass=mass, stiffness=[float(mass * k) for k in stiffness],
        damping=[float(mass * d) for d in damping], position=[0.3 * amplitude, 0.0],
        fingers=fingers.tolist(), mismatch=mismatch.tolist(), feedback=float(feedback),
        noise=float(swing * 10.0 ** (-snr / 20.0)), adc_bits=int(rng.integers(16, 25)),
        full_scale_V=float(3.0 * swing), full_scale=float(omega**2 * amplitude * rng.uniform(0.01, 0.06)),
        latency=latency, drive_noise=float(rng.choice([0.0, 1e-9]) * omega**1.5 * amplitude),
        rate_Hz=rate_Hz, rate=rate,
    )  # fmt: skip
    return Drawn(text, truth, latency, amplitude, snr)


def written(drawn: Drawn, folder: Path, name: str) -> Path:
    """Its scenario as a file."""
    place = folder / f"{name}.scenario.toml"
    place.write_text(drawn.text)
    return place


def _turned(values: np.ndarray, angle: float) -> list[float]:
    """[xx, yy, xy] of a matrix with these values along an angle and across it."""
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.array([[c, -s], [s, c]]) @ np.diag(values) @ np.array([[c, s], [-s, c]])
    return [float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 1])]
