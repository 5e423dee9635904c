"""What is hidden in a record: for each effect a range from physics, and a draw from it, as `[[effect]]` tables.

A size is stated without units, in the device's own scale (amplitude A, frequency ω, spring force kA), and drawn
log-uniformly; a second coefficient (the other axis) is of the same order and either sign, unless physics says
otherwise, and in one draw of three there is none: the effect is on one axis alone.  Next to each range stands where it
comes from; it goes on to `BEYOND` times as much where the device can still be held on its orbit.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evaluation.undeclared.device import DrawnDevice

BEYOND = 3.0
"""By how much an effect may be larger than what its range has from practice."""

_ONE_AXIS = 1.0 / 3.0
_NO_CORNER = 1e-6  # resonance over a corner so far away that there is none

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
    """A kind of hidden effect. `low`, `high`: range of its size; `slow`: its time constants are those of a device near
    S-slow; `ends`: its range ends where it does because beyond it would be something else.
    """

    name: str
    low: float
    high: float
    build: Callable[[Rng, DrawnDevice, float], Hidden]
    why: str
    slow: bool = False
    ends: bool = False

    @property
    def largest(self) -> float:
        """Size up to which it is drawn."""
        return self.high if self.ends else BEYOND * self.high

    def draw(self, rng: Rng, device: DrawnDevice) -> Hidden:
        """One draw."""
        size = math.exp(rng.uniform(math.log(self.low), math.log(self.largest)))
        return self.build(rng, device, size)


def _sign(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _pair(rng: Rng, size: float) -> tuple[float, float]:
    """Two axes, the larger of size `size`, either sign, or one axis alone."""
    both = [_sign(rng) * size, _sign(rng) * size * _other(rng)]
    rng.shuffle(both)
    return both[0], both[1]


def _alike(rng: Rng, size: float) -> tuple[float, float]:
    """As `_pair`, of one sign: springs of one process harden or soften together, and losses are positive."""
    both = [size, size * _other(rng)]
    rng.shuffle(both)
    return both[0], both[1]


def _other(rng: Rng) -> float:
    """What the other axis has, of the first one's."""
    return 0.0 if rng.random() < _ONE_AXIS else float(rng.uniform(0.3, 1.0))


def _one(name: str, size: float, **coefficients: float) -> Hidden:
    return Hidden([{"name": name, **coefficients}], size)


def _spring(name: str, symbol: str, power: int) -> Callable[[Rng, DrawnDevice, float], Hidden]:
    """A force of each axis that is to that of the stiffness as the amplitude to this power."""

    def build(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
        sign, unit = _sign(rng), d.omega**2 / d.amplitude_m**power
        x, y = _alike(rng, size)
        return _one(name, size, **{f"{symbol}x": sign * x * unit, f"{symbol}y": sign * y * unit})

    return build


def _radial_spring(name: str, symbol: str, power: int) -> Callable[[Rng, DrawnDevice, float], Hidden]:
    """The same along the radius."""

    def build(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
        return _one(name, size, **{symbol: _sign(rng) * size * d.omega**2 / d.amplitude_m**power})

    return build


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
    return _one("dry_friction", size, fx=x * unit, fy=y * unit, v0=v0)


def _sense_gain(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    # On y alone: the length scale of a record is that of x, and a gain common to both is a drive gain.
    return _one("sense_gain", size, gy=_sign(rng) * size)


def _misalignment(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size)
    return _one("drive_misalignment", size, mx=x, my=y)


def _cross_coupling(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size)
    return _one("sense_cross_coupling", size, ex=x, ey=y)


def _sense_quadratic(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size)
    return _one("sense_quadratic", size, a2x=x / d.amplitude_m, a2y=y / d.amplitude_m)


def _sense_cubic(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _alike(rng, size)
    unit = _sign(rng) / d.amplitude_m**2
    return _one("sense_cubic", size, a3x=x * unit, a3y=y * unit)


def _sense_delay(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _alike(rng, size)
    return _one("sense_delay", size, tsx=x / d.omega, tsy=y / d.omega)


def _drive_delay(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _alike(rng, size)
    return _one("drive_delay", size, tux=x / d.omega, tuy=y / d.omega)


def _high_pass(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    feedback = 2.0 * 5.0 * 100.0 * 8.8541878128e-12 / abs(d.gain_V_per_m)
    # Two resistors of one die, within 30 %.
    resistors = [1.0 / (d.omega * feedback * s) for s in (size, size * rng.uniform(0.7, 1.0))]
    return Hidden([], size, {"sense": {"feedback_ohm": resistors}})


def _low_pass(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    return Hidden(
        [], size, {"sense": {"low_pass_Hz": [d.frequency_Hz / max(s, _NO_CORNER) for s in _alike(rng, size)]}}
    )


def _drive_gain(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size)
    return _one("drive_gain", size, hx=x, hy=y)


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
        x, y = size * unit, size * unit * _other(rng)
        psi = rng.uniform(-math.pi, math.pi, 2)
        return _one(name, size, ax=x, ay=y, frequency=frequency, phase_x=float(psi[0]), phase_y=float(psi[1]))

    return build


def _friction_asymmetric(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    plain = _friction(rng, d, size).effects[0]
    x, y = _pair(rng, rng.uniform(0.1, 0.5))
    return Hidden([plain | {"name": "dry_friction_asymmetric", "ax": x, "ay": y}], size)


def _nonreciprocal(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    return _one("nonreciprocal_stiffness", size, kn=_sign(rng) * size * d.omega**2)


def _clipping(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    level = size * d.crest * d.amplitude_m * abs(d.gain_V_per_m)  # one supply, one pair of rails
    return _one("sense_clipping", size, limit_x=level, limit_y=level)


def _parasitic(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size)
    frequency = d.frequency_Hz * math.exp(rng.uniform(math.log(1.5), math.log(6.0)))
    zeta = math.exp(rng.uniform(math.log(1e-3), math.log(2e-2)))
    return _one("parasitic_mode", size, frequency=frequency, zeta=zeta, rx=x, ry=y)


def _electrostatic(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size)
    return _one("electrostatic_drive", size, qx=x / d.drive_mps2, qy=y / d.drive_mps2)


def _drive_saturation(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    limit = size * d.drive_mps2
    return _one("drive_saturation", size, limit_x=limit, limit_y=limit)


def _dead_band(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    width = size * d.drive_mps2
    return _one("drive_dead_band", size, width_x=width, width_y=width)


def _thermal(name: str, sign: float | None) -> Callable[[Rng, DrawnDevice, float], Hidden]:
    def build(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
        return _one(name, size, tc=size * (sign or _sign(rng)))

    return build


def _thermal_offset(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size)
    unit = abs(d.gain_V_per_m) * d.amplitude_m
    return _one("temperature_offset", size, tc_x=x * unit, tc_y=y * unit)


def _support(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    reaction = size * d.peak_mps2
    static = reaction * rng.uniform(0.3, 0.9)
    return _one(
        "stick_slip_support",
        size,
        ratio=size,
        frequency=d.frequency_Hz * rng.uniform(0.05, 0.3),
        Fs=static,
        Fc=static * rng.uniform(0.5, 0.8),
        vs=0.05 * size * d.amplitude_m * d.omega,
        s=(d.omega * rng.uniform(2.0, 4.0)) ** 2,
    )


def _backlash(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _alike(rng, size * d.omega**2)
    return _one("backlash", size, kbx=x, kby=y, gap=d.amplitude_m * rng.uniform(0.3, 0.9))


def _hysteretic(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _alike(rng, size * d.omega**2)
    return _one("hysteretic_stiffness", size, khx=x, khy=y, reach=d.amplitude_m * rng.uniform(0.05, 0.5))


def _telegraph(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _alike(rng, size * abs(d.gain_V_per_m) * d.amplitude_m)
    return _one("telegraph_offset", size, ax=x, ay=y, rate=d.frequency_Hz / 200.0 * rng.uniform(1.0, 20.0))


def _parametric(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    frequency = d.frequency_Hz * math.exp(rng.uniform(math.log(0.03), math.log(0.6)))
    phase = float(rng.uniform(-math.pi, math.pi))
    return _one("parametric_stiffness", size, depth=size, frequency=frequency, phase=phase)


def _coupling(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    return _one("nonlinear_coupling", size, c=_sign(rng) * size * d.omega**2 / d.amplitude_m**2)


def _missing_codes(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    return _one("missing_codes", size, every=4096.0, width=float(round(size)))


def _slew(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    steepest = size * d.omega * d.drive_mps2
    return _one("drive_slew", size, slew_x=steepest, slew_y=steepest)


def _angular_gain(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    return _one("angular_gain", size, kappa=-size)


def _constant_force(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    x, y = _pair(rng, size * d.peak_mps2)
    return _one("constant_force", size, ax=x, ay=y)


def _flicker(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    # A corner frequency below the resonance: density of the white noise times √corner, at 1 Hz.
    corner = size * d.frequency_Hz
    return Hidden([], size, {"sense": {"flicker_V_at_1Hz": d.noise_V * math.sqrt(2.0 * corner / d.sample_rate_Hz)}})


def _coarse(rng: Rng, d: DrawnDevice, size: float) -> Hidden:
    # Steps of `size` deviations of the noise; beyond 2 their error is no noise any more.
    bits = round(math.log2(2.0 * 0.25 / (size * d.noise_V)))
    return Hidden([], size, {"sense": {"adc_bits": bits}})


_ALL = (
    Drawable(
        "cubic_stiffness",
        1e-3,
        5e-2,
        _spring("cubic_stiffness", "k3", 2),
        "k3 A²/k: clamped springs harden, combs soften, by up to some %",
    ),
    Drawable(
        "cubic_isotropic", 1e-3, 5e-2, _radial_spring("cubic_isotropic", "k3", 2), "k3 A²/k, the same on every axis"
    ),
    Drawable(
        "quintic_stiffness",
        2e-3,
        5e-2,
        _spring("quintic_stiffness", "k5", 4),
        "k5 A⁴/k: what a spring has beyond its cubic term",
    ),
    Drawable(
        "quintic_isotropic",
        2e-3,
        5e-2,
        _radial_spring("quintic_isotropic", "k5r", 4),
        "k5 A⁴/k, the same on every axis",
    ),
    Drawable("quadratic_stiffness", 1e-3, 3e-2, _quadratic, "k2 A/k: electrostatic spring of unequal gaps"),
    Drawable("nonlinear_damping", 0.05, 1.0, _nonlinear_damping, "d3 A² over the linear damping"),
    Drawable("dry_friction", 0.05, 1.0, _friction, "F over the linear damping's largest force"),
    Drawable("dry_friction_asymmetric", 0.05, 1.0, _friction_asymmetric, "as dry friction; 10 to 50 % more one way"),
    Drawable(
        "nonreciprocal_stiffness", 1e-4, 5e-3, _nonreciprocal, "kn/k: feedback that leaks across, in a stiff loop"
    ),
    Drawable("sense_gain", 1e-3, 3e-2, _sense_gain, "uncalibrated capacitors and amplifiers match to some %"),
    Drawable("sense_cross_coupling", 1e-3, 3e-2, _cross_coupling, "misalignment, stray capacitance"),
    Drawable("sense_quadratic", 1e-3, 3e-2, _sense_quadratic, "α2 A: parallel-plate capacitance, unequal gaps"),
    Drawable("sense_cubic", 1e-3, 3e-2, _sense_cubic, "α3 A²: (A/gap)² of parallel plates"),
    Drawable("sense_delay", 1e-3, 5e-2, _sense_delay, "ω τ: 1 to 40 µs at 200 Hz"),
    Drawable("sense_high_pass", 1e-3, 5e-2, _high_pass, "1/(ω Rf Cf)"),
    Drawable("sense_low_pass", 1e-2, 0.3, _low_pass, "resonance over corner frequency"),
    Drawable("drive_gain", 3e-3, 5e-2, _drive_gain, "amplifiers and forcers match to some %"),
    Drawable("drive_misalignment", 3e-3, 5e-2, _misalignment, "rad"),
    Drawable("drive_delay", 3e-3, 0.1, _drive_delay, "ω τ"),
    Drawable("drive_feedthrough", 3e-3, 0.3, _feedthrough, "γ k over the sense gain: stray capacitance"),
    Drawable("interference", 1e-3, 3e-2, _line("interference"), "of the amplitude's voltage: mains, clocks"),
    Drawable("base_vibration", 3e-4, 1e-2, _line("base_vibration"), "of k A: 0.05 to 1.5 m/s² at S-slow"),
    # Deeper, and the energy hold takes the missing tops for a loss and drives the mass into its stops.
    Drawable("sense_clipping", 0.92, 0.99, _clipping, "level over the largest amplitude", ends=True),
    Drawable("parasitic_mode", 3e-2, 1.0, _parasitic, "γ c: share of the drive that another mode takes and shows"),
    Drawable("electrostatic_drive", 3e-3, 0.1, _electrostatic, "largest drive over four times the bias"),
    Drawable("drive_saturation", 0.4, 0.9, _drive_saturation, "limit over the largest force needed", ends=True),
    Drawable("drive_dead_band", 5e-3, 0.1, _dead_band, "band over the largest force needed"),
    Drawable(
        "temperature_stiffness", 2e-5, 2e-4, _thermal("temperature_stiffness", -1.0), "1/K; silicon 6e-5", slow=True
    ),
    Drawable("temperature_damping", 2e-3, 2e-2, _thermal("temperature_damping", None), "1/K", slow=True),
    Drawable("temperature_offset", 1e-4, 1e-2, _thermal_offset, "of the amplitude per K", slow=True),
)
_OUTSIDE = (
    Drawable("stick_slip_support", 3e-4, 1e-2, _support, "mass of the proof mass over that of the package"),
    Drawable("backlash", 1e-3, 3e-2, _backlash, "of k: an anchor with play"),
    Drawable("hysteretic_stiffness", 1e-3, 2e-2, _hysteretic, "of k: slip in a die attach"),
    Drawable("telegraph_offset", 1e-3, 3e-2, _telegraph, "of the amplitude's voltage: a trap in an input transistor"),
    Drawable("parametric_stiffness", 1e-4, 1e-2, _parametric, "of k: ripple of a bias"),
    Drawable("nonlinear_coupling", 1e-3, 3e-2, _coupling, "c A²/k, potential c x³ y"),
    Drawable("missing_codes", 20.0, 200.0, _missing_codes, "codes lost at each major carry"),
    Drawable("drive_slew", 0.3, 3.0, _slew, "steepest change over that of the largest force needed"),
)
_NEVER = (
    Drawable("angular_gain", 1e-2, 0.3, _angular_gain, "1 - κ; a wine-glass mode has 0.3", ends=True),
    Drawable("constant_force", 1e-3, 3e-2, _constant_force, "of k A: 0.02 to 0.5 g at S-slow", ends=True),
    Drawable("flicker_noise", 1e-3, 3e-2, _flicker, "corner over the resonance", ends=True),
    Drawable("coarse_converter", 0.5, 2.0, _coarse, "step over the noise", ends=True),
)

DRAWABLE = {drawable.name: drawable for drawable in _ALL}
"""What the catalogue of tracing has, under its names there."""

OUTSIDE = {drawable.name: drawable for drawable in _OUTSIDE}
"""What it lacks."""

NEVER = {drawable.name: drawable for drawable in _NEVER}
"""What no record shows beside the base model, or no model accounts for: nothing to add."""

EFFECTS = {**DRAWABLE, **OUTSIDE, **NEVER}
