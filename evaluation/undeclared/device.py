"""A random device, what its data sheet declares of it, and the excitation it is recorded under.

Devices lie between S-slow (200 Hz, 1 g) and S-modern (10 kHz, 10 ng): half of them near S-slow, half anywhere in
between on a logarithmic scale.  Everything that can be stated without units (mismatch, Q, noise below amplitude,
samples a cycle) is drawn from one range for all of them.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

BOLTZMANN_J_PER_K = 1.380649e-23
_PERMITTIVITY = 8.8541878128e-12
_FINGERS, _BIAS_V = 100.0, 5.0
_FULL_SCALE_V = 0.25
_DECLARED_OFF = 0.02  # largest error of the declared stiffness


@dataclass(frozen=True)
class DrawnDevice:
    """Numbers of one device, SI; stiffness [xx, yy, xy] in 1/s² and damping in 1/s, both per unit mass."""

    slow: bool
    crest: float  # largest amplitude under the excitation, over the nominal
    frequency_Hz: float
    mass_kg: float
    amplitude_m: float
    sample_rate_Hz: float
    stiffness: tuple[float, float, float]
    damping: tuple[float, float, float]
    gain_V_per_m: float
    noise_V: float
    offset_m: tuple[float, float]
    angle_rad: float  # of the vibration at the start
    rate_rad_s: float  # size of its rates
    virtual_rotation_rad_s: float
    declared_stiffness: tuple[float, float, float]
    declared_damping: tuple[float, float, float]

    @property
    def omega(self) -> float:
        """Target frequency, rad/s: √ of the mean stiffness."""
        return math.sqrt(0.5 * (self.stiffness[0] + self.stiffness[1]))

    @property
    def peak_mps2(self) -> float:
        """k A, the largest spring force per unit mass."""
        return self.omega**2 * self.amplitude_m

    @property
    def drive_mps2(self) -> float:
        """Largest force that the control law needs in the long run, per unit mass: what the mismatch, the cross-
        stiffness and the virtual rotation take at the crest of the modulation.
        """
        kxx, kyy, kxy = self.stiffness
        relative = (0.5 * abs(kxx - kyy) + abs(kxy)) / self.omega**2 + 2.0 * self.virtual_rotation_rad_s / self.omega
        return self.crest * relative * self.peak_mps2


def draw_device(rng: np.random.Generator, *, crest: float, slow: bool) -> DrawnDevice:
    """A device; `slow` asks for one near S-slow."""
    near = slow or bool(rng.random() < 0.5)
    scale = 0.0 if near else rng.uniform(0.0, 1.0)
    frequency = 200.0 * 50.0**scale * rng.uniform(0.75, 1.3)
    omega = 2.0 * math.pi * frequency
    k = omega**2
    split, cross = rng.uniform(0.002, 0.04) * rng.choice([-1, 1]), rng.uniform(0.0005, 0.02) * rng.choice([-1, 1])
    stiffness = (k * (1.0 + 0.5 * split), k * (1.0 - 0.5 * split), k * cross)
    d = omega / math.exp(rng.uniform(math.log(500.0), math.log(2000.0)))
    anisotropy = rng.uniform(-0.1, 0.1)
    damping = (d * (1.0 + anisotropy), d * (1.0 - anisotropy), d * rng.uniform(-0.05, 0.05))
    amplitude = 1e-4 * 0.02**scale * rng.uniform(0.7, 1.3)
    amplitude_V = rng.uniform(0.07, 0.12)
    rate = min(1.25e-3 * omega * math.exp(rng.uniform(math.log(0.5), math.log(2.0))), 35.0)
    off = 1.0 + _DECLARED_OFF * rng.uniform(-1.0, 1.0, 2)
    declared = (stiffness[0] * off[0], stiffness[1] * off[1], stiffness[2] + 0.002 * k * rng.standard_normal())
    misjudged = rng.uniform(0.5, 1.5, 2)
    return DrawnDevice(
        slow=near,
        crest=crest,
        frequency_Hz=frequency,
        mass_kg=1e-3 * 1e-5**scale,
        amplitude_m=amplitude,
        sample_rate_Hz=round(frequency * rng.uniform(16.0, 28.0), 1),
        stiffness=stiffness,
        damping=damping,
        gain_V_per_m=-amplitude_V / amplitude,
        noise_V=amplitude_V * 10.0 ** (-rng.uniform(60.0, 70.0) / 20.0),
        offset_m=(amplitude * rng.uniform(-0.1, 0.1), amplitude * rng.uniform(-0.1, 0.1)),
        angle_rad=rng.uniform(-math.pi, math.pi),
        rate_rad_s=rate,
        virtual_rotation_rad_s=2.4e-3 * omega * rng.uniform(0.8, 1.5),
        declared_stiffness=declared,
        declared_damping=(damping[0] * misjudged[0], damping[1] * misjudged[1], 0.0),
    )


def draw_rate(rng: np.random.Generator, device: DrawnDevice, duration_s: float) -> dict[str, Any]:
    """`[rate]` of a scenario: a sine about an offset, or steps between rates that a table with finite torque makes."""
    size = device.rate_rad_s
    if rng.random() < 0.6:
        return {
            "kind": "sine",
            "amplitude_rad_s": float(size * rng.uniform(0.5, 1.0)),
            "frequency_Hz": float(rng.uniform(2.0, 12.0) / duration_s),
            "phase_rad": float(rng.uniform(-math.pi, math.pi)),
            "offset_rad_s": float(size * rng.uniform(-0.5, 0.5)),
        }
    times = np.concatenate([[0.0], np.sort(rng.uniform(0.1, 0.95, 4)) * duration_s])
    rates = size * rng.uniform(-1.0, 1.0, 5)
    return {"kind": "steps", "times_s": times.tolist(), "rates_rad_s": rates.tolist()}


def scenario_table(device: DrawnDevice, rate: dict[str, Any], seed: int) -> dict[str, Any]:
    """The scenario of a device without any hidden effect, as a TOML file would give it."""
    # The finger width sets the gain: |gain| = 2 V/Cf N ε W/Z.
    feedback_F = 2.0 * _BIAS_V * _FINGERS * _PERMITTIVITY / abs(device.gain_V_per_m)
    a = device.amplitude_m
    return {
        "seed": seed,
        "truth": {
            "mass_kg": device.mass_kg,
            "stiffness_N_per_m": [k * device.mass_kg for k in device.stiffness],
            "damping_N_s_per_m": [d * device.mass_kg for d in device.damping],
            "temperature_K": 300.0,
            "position_m": [a * math.cos(device.angle_rad), a * math.sin(device.angle_rad)],
        },
        "sense": {
            "fingers": _FINGERS,
            "width_m": 2e-6,
            "gap_m": 2e-6,
            "overlap_m": 2.0 * a,
            "mismatch_m": list(device.offset_m),
            "bias_V": _BIAS_V,
            "feedback_F": feedback_F,
            "noise_V": device.noise_V,
            "adc_bits": 16,
            "adc_full_scale_V": _FULL_SCALE_V,
        },
        "drive": {"dac_bits": 16, "full_scale_mps2": 0.12 * device.peak_mps2, "latency_samples": 1},
        "board": {"sample_rate_Hz": device.sample_rate_Hz, "unique_id": seed, "firmware": 0x00010000},
        "rate": rate,
    }


def bench_table(device: DrawnDevice, duration_s: float, excited: bool, turning: bool) -> dict[str, Any]:
    """The bench file of the data sheet; `excited`: the reference excitation; `turning`: virtual rotation on."""
    f, mass = device.frequency_Hz, device.mass_kg
    d = sum(device.declared_damping[:2]) / 2.0
    memory = 200.0 / f
    lsb = 2.0 * _FULL_SCALE_V / 2**16
    return {
        "link": {"watchdog_s": max(0.02, 20.0 / device.sample_rate_Hz)},
        "device": {
            "name": "undeclared",
            "mass_kg": mass,
            "stiffness_N_per_m": [k * mass for k in device.declared_stiffness],
            "damping_N_s_per_m": [d * mass for d in device.declared_damping],
            "amplitude_m": device.amplitude_m,
            "sample_rate_Hz": device.sample_rate_Hz,
            "sense": {
                "gain_V_per_m": device.gain_V_per_m,
                "noise_V": math.hypot(device.noise_V, lsb / math.sqrt(12.0)),
                "offset_sd_V": 0.1 * abs(device.gain_V_per_m) * device.amplitude_m,
            },
            "drive": {"unit": "mps2", "full_scale": 0.12 * device.peak_mps2},
        },
        "loop": {
            "name": "undeclared",
            "clock": "lockstep",
            "duration_s": duration_s,
            "settle_s": min(4.0 * memory, 0.4 * duration_s),
        },
        "observer": {
            "memory_s": memory,
            "acquisition_s": 20.0 / f,
            "initial_sd": {"rate_rad_s": 2.0 * device.rate_rad_s},
            "process_noise": {
                "force_mps2_per_rtHz": math.sqrt(4.0 * BOLTZMANN_J_PER_K * 300.0 * d / mass),
                "rate_rad_s_per_rts": 0.64 * device.rate_rad_s * math.sqrt(f / 200.0),
            },
        },
        "controller": {
            "energy_gain": 0.1,
            "quadrature_gain": 0.1,
            "virtual_rotation_rad_s": device.virtual_rotation_rad_s if turning else 0.0,
            "dither_mps2": 2.2e-3 * device.peak_mps2 if excited else 0.0,
            "amplitude_modulation": 0.3 if excited else 0.0,
            "modulation_Hz": f / 200.0,
        },
        # Wide: the record is what it is.
        "limits": {"residual_safe": 1e12, "energy_error": 1e3, "quadrature": 1.0},
    }


def draw_temperature(rng: np.random.Generator, duration_s: float) -> dict[str, float]:
    """`[temperature]`: warming by a few kelvin from being switched on, under the slow swing of a room or an oven."""
    return {
        "warm_up_K": float(rng.uniform(2.0, 8.0)),
        "time_constant_s": float(duration_s * rng.uniform(0.2, 0.8)),
        "swing_K": float(rng.uniform(0.2, 1.5)),
        "period_s": float(duration_s * rng.uniform(0.15, 0.6)),
    }


def temperature_C(profile: dict[str, float], t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """What a thermometer on the board shows, 25 °C at first."""
    warm = profile["warm_up_K"] * (1.0 - np.exp(-t_s / profile["time_constant_s"]))
    return np.asarray(25.0 + warm + profile["swing_K"] * np.sin(2.0 * math.pi * t_s / profile["period_s"]))
