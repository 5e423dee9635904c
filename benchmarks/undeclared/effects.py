"""What is hidden in a record: for each effect a range from physics, and a draw from it, as `[[effect]]` tables.

A size is stated without units, in the device's own scale (amplitude A, frequency ω, spring force kA), and drawn
log-uniformly; a second coefficient (the other axis) is of the same order and either sign, unless physics says
otherwise.  Next to each range stands where it comes from.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.undeclared.device import DrawnDevice

Rng = np.random.Generator
Tables = list[dict[str, Any]]


@dataclass(frozen=True)
class Hidden:
    """What one draw hides: `[[effect]]` tables, changed keys of other sections, and its size in the device's scale."""

    effects: Tables
    size: float
    sections: Mapping[str, dict[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Drawable:
    """A kind of hidden effect. `low`, `high`: range of its size; `slow`: only devices near S-slow can have it."""

    name: str
    low: float
    high: float
    build: Callable[[Rng, DrawnDevice, float], Hidden]
    why: str
    slow: bool | None = None

    def draw(self, rng: Rng, device: DrawnDevice) -> Hidden:
        """One draw."""
        size = math.exp(rng.uniform(math.log(self.low), math.log(self.high)))
        return self.build(rng, device, size)


def _sign(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _pair(rng: Rng, size: float) -> tuple[float, float]:
    """Two axes, the larger of size `size`, either sign."""
    both = [_sign(rng) * size, _sign(rng) * size * rng.uniform(0.3, 1.0)]
    rng.shuffle(both)
    return both[0], both[1]


def _alike(rng: Rng, size: float) -> tuple[float, float]:
    """Two axes of one sign: springs of one process harden or soften together, and losses are positive."""
    both = [size, size * rng.uniform(0.3, 1.0)]
    rng.shuffle(both)
    return both[0], both[1]


def _one(name: str, size: float, **coefficients: float) -> Hidden:
    return Hidden([{"name": name, **coefficients}], size)


def _cubic(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    sign, unit = _sign(rng), d.omega**2 / d.amplitude_m**2
    x, y = _alike(rng, size)
    return _one("cubic_stiffness", size, k3x=sign * x * unit, k3y=sign * y * unit)


def _cubic_isotropic(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    return _one("isotropic_cubic_stiffness", size, k3=_sign(rng) * size * d.omega**2 / d.amplitude_m**2)


def _quadratic(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size)
    unit = d.omega**2 / d.amplitude_m
    return _one("quadratic_stiffness", size, k2x=x * unit, k2y=y * unit)


def _nonlinear_damping(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _alike(rng, size)
    unit = 0.5 * (d.damping[0] + d.damping[1]) / d.amplitude_m**2
    return _one("nonlinear_damping", size, d3x=x * unit, d3y=y * unit)


def _friction(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _alike(rng, size)
    unit = 0.5 * (d.damping[0] + d.damping[1]) * d.omega * d.amplitude_m
    v0 = d.omega * d.amplitude_m * math.exp(rng.uniform(math.log(3e-3), math.log(2e-2)))
    return _one("dry_friction", size, Fx=x * unit, Fy=y * unit, v0=v0)


def _sense_gain(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    # On y alone: the length scale of a record is that of x, and a gain common to both is a drive gain.
    return _one("sense_gain", size, gy=_sign(rng) * size)


def _crossed(name: str) -> Callable[[Rng, DrawnDevice, float], Hidden]:
    def build(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
        x, y = _pair(rng, size)
        return _one(name, size, exy=x, eyx=y)

    return build


def _sense_quadratic(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size)
    return _one("sense_quadratic", size, a2x=x / d.amplitude_m, a2y=y / d.amplitude_m)


def _sense_cubic(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _alike(rng, size)
    unit = _sign(rng) / d.amplitude_m**2
    return _one("sense_cubic", size, a3x=x * unit, a3y=y * unit)


def _delay(name: str) -> Callable[[Rng, DrawnDevice, float], Hidden]:
    def build(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
        x, y = _alike(rng, size)
        return _one(name, size, tau_x=x / d.omega, tau_y=y / d.omega)

    return build


def _high_pass(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    feedback = 2.0 * 5.0 * 100.0 * 8.8541878128e-12 / abs(d.gain_V_per_m)
    resistors = [1.0 / (d.omega * feedback * s) for s in _alike(rng, size)]
    return Hidden([], size, {"sense": {"feedback_ohm": resistors}})


def _low_pass(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    return Hidden([], size, {"sense": {"low_pass_Hz": [d.frequency_Hz / s for s in _alike(rng, size)]}})


def _drive_gain(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size)
    return _one("drive_gain", size, gx=x, gy=y)


def _feedthrough(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size)
    unit = d.gain_V_per_m / d.omega**2
    return _one("drive_feedthrough", size, gamma_x=x * unit, gamma_y=y * unit)


def _line(name: str) -> Callable[[Rng, DrawnDevice, float], Hidden]:
    def build(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
        low = [(0.03, 0.9), (1.1, 0.45 * d.sample_rate_Hz / d.frequency_Hz)]  # off the resonance, below half the rate
        below = rng.random() < 0.5
        a, b = low[0] if below else low[1]
        frequency = d.frequency_Hz * math.exp(rng.uniform(math.log(a), math.log(b)))
        unit = abs(d.gain_V_per_m) * d.amplitude_m if name == "interference" else d.peak_mps2
        x, y = size * unit, size * unit * rng.uniform(0.3, 1.0)
        psi = rng.uniform(-math.pi, math.pi, 2)
        return _one(name, size, ax=x, ay=y, frequency=frequency, phase_x=float(psi[0]), phase_y=float(psi[1]))

    return build


_ALL = (
    Drawable("cubic_stiffness", 1e-3, 5e-2, _cubic, "k3 A²/k: clamped springs harden, combs soften, by up to some %"),
    Drawable("cubic_isotropic", 1e-3, 5e-2, _cubic_isotropic, "k3 A²/k, the same on every axis"),
    Drawable("quadratic_stiffness", 1e-3, 3e-2, _quadratic, "k2 A/k: electrostatic spring of unequal gaps"),
    Drawable("nonlinear_damping", 0.05, 1.0, _nonlinear_damping, "d3 A² over the linear damping"),
    Drawable("dry_friction", 0.05, 1.0, _friction, "F over the linear damping's largest force"),
    Drawable("sense_gain", 1e-3, 3e-2, _sense_gain, "uncalibrated capacitors and amplifiers match to some %"),
    Drawable("sense_cross_coupling", 1e-3, 3e-2, _crossed("sense_cross_coupling"), "misalignment, stray capacitance"),
    Drawable("sense_quadratic", 1e-3, 3e-2, _sense_quadratic, "α2 A: parallel-plate capacitance, unequal gaps"),
    Drawable("sense_cubic", 1e-3, 3e-2, _sense_cubic, "α3 A²: (A/gap)² of parallel plates"),
    Drawable("sense_delay", 1e-3, 5e-2, _delay("sense_delay"), "ω τ: 1 to 40 µs at 200 Hz"),
    Drawable("sense_high_pass", 1e-3, 5e-2, _high_pass, "1/(ω Rf Cf)"),
    Drawable("sense_low_pass", 1e-2, 0.3, _low_pass, "resonance over corner frequency"),
    Drawable("drive_gain", 3e-3, 5e-2, _drive_gain, "amplifiers and forcers match to some %"),
    Drawable("drive_misalignment", 3e-3, 5e-2, _crossed("drive_misalignment"), "rad"),
    Drawable("drive_delay", 3e-3, 0.1, _delay("drive_delay"), "ω τ"),
    Drawable("drive_feedthrough", 3e-3, 0.3, _feedthrough, "γ k over the sense gain: stray capacitance"),
    Drawable("interference", 1e-3, 3e-2, _line("interference"), "of the amplitude's voltage: mains, clocks"),
    Drawable("base_vibration", 3e-4, 1e-2, _line("base_vibration"), "of k A: 0.05 to 1.5 m/s² at S-slow"),
)
_OUTSIDE: tuple[Drawable, ...] = ()
DRAWABLE = {drawable.name: drawable for drawable in _ALL}
OUTSIDE = {drawable.name: drawable for drawable in _OUTSIDE}
EFFECTS = {**DRAWABLE, **OUTSIDE}
