"""What birch.py hides in a device: laws of docs/reference/effects.md, and laws that no catalogue has.

A law has coefficients of one unit, drawn as shares of `unit` times a size below `cap`; `cap` is what a bench-top device
may have at most. Symbols are parameters of birch.c.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Scales:
    """What sizes are measured by."""

    w: float  # resonance, rad/s
    amplitude: float  # m
    ts: float  # sample interval, s
    duration: float  # of the record, s
    peak: float  # largest reading, m
    drive_rms: float  # m/s²
    drive: NDArray[np.float64]  # sorted magnitudes of the drive, m/s²

    def drive_quantile(self, share: float) -> float:
        """Magnitude below which this share of the drive lies, m/s²."""
        return float(self.drive[int(share * (len(self.drive) - 1))])


Parameters = Callable[[np.random.Generator, Scales], dict[str, float]]


@dataclass(frozen=True)
class Law:
    """An effect: how its coefficients are drawn. `signs`: "any", or "positive" where another sign is no such effect."""

    family: str
    description: str
    symbols: tuple[str, ...]
    unit: Callable[[Scales], float]
    cap: float
    signs: str = "any"
    parameters: Parameters | None = None
    weight: float = 1.0
    on_request: bool = False

    def shape(self, rng: np.random.Generator) -> dict[str, float]:
        """Shares of the coefficients: one is 1 in magnitude, others are smaller, some 0."""
        n = len(self.symbols)
        shares = rng.uniform(0.2, 1.0, n) * (rng.random(n) > 0.2)
        if self.signs == "any":
            shares *= rng.choice([-1.0, 1.0], n)
        shares[rng.integers(n)] = 1.0 if self.signs == "positive" else rng.choice([-1.0, 1.0])
        return {symbol: float(share) for symbol, share in zip(self.symbols, shares, strict=True)}


PAGE_NAMES = {"mode_w": "omega", "mode_zeta": "zeta", "line_w": "omega", "base_w": "omega"}


def _one(_: Scales) -> float:
    return 1.0


def _stiffness(s: Scales) -> float:
    return s.w**2


def _friction_speed(rng: np.random.Generator, s: Scales) -> dict[str, float]:
    return {"v0": s.amplitude * s.w * 10 ** rng.uniform(-2.5, -1.5)}


def _away(rng: np.random.Generator, s: Scales, low: float, high: float) -> float:
    """A frequency from low to high times the resonance, rad/s, no nearer to it than 15 %."""
    while True:
        ratio = 10 ** rng.uniform(math.log10(low), math.log10(high))
        if abs(ratio - 1) > 0.15:
            return float(ratio * s.w)


def _lag(name: str, low: float, high: float) -> Parameters:
    """A time constant from low to high cycles of the resonance, s."""
    return lambda rng, s: {name: 2 * math.pi / s.w * 10 ** rng.uniform(math.log10(low), math.log10(high))}


CATALOGUE: dict[str, Law] = {
    "cubic_stiffness": Law(
        "spring", "cubic stiffness of each axis", ("k3x", "k3y"), lambda s: s.w**2 / s.amplitude**2, 0.1
    ),
    "cubic_isotropic": Law(
        "spring", "cubic stiffness along the radius", ("k3",), lambda s: s.w**2 / s.amplitude**2, 0.1
    ),
    "quadratic_stiffness": Law(
        "spring", "quadratic stiffness of each axis", ("k2x", "k2y"), lambda s: s.w**2 / s.amplitude, 0.08
    ),
    "nonreciprocal_stiffness": Law("spring", "stiffness that is not symmetric", ("kn",), _stiffness, 0.004),
    "nonlinear_damping": Law(
        "loss",
        "damping that grows with the displacement",
        ("d3x", "d3y"),
        lambda s: s.w / s.amplitude**2,
        0.02,
        "positive",
        weight=2.0,
    ),
    "dry_friction": Law(
        "loss",
        "dry friction, tanh(v/v0)",
        ("fx", "fy"),
        lambda s: s.w**2 * s.amplitude,
        0.006,
        "positive",
        _friction_speed,
        weight=4.0,
    ),
    "dry_friction_asymmetric": Law(
        "loss",
        "dry friction that is larger one way than the other",
        ("fax", "fay"),
        lambda s: s.w**2 * s.amplitude,
        0.02,
        parameters=_friction_speed,
        weight=1.5,
    ),
    "damping_asymmetric": Law(
        "loss", "damping that is larger one way, |v| exactly", ("dax", "day"), lambda s: s.w, 0.02, weight=3.0
    ),
    "drag": Law(
        "loss",
        "drag of each axis, v |v| exactly",
        ("dqx", "dqy"),
        lambda s: 1 / s.amplitude,
        0.02,
        "positive",
        weight=4.0,
    ),
    "cubic_damping": Law(
        "loss",
        "damping with the cube of the speed",
        ("dcx", "dcy"),
        lambda s: 1 / (s.w * s.amplitude**2),
        0.02,
        "positive",
        weight=2.0,
    ),
    "drag_radial": Law(
        "loss",
        "drag against the motion, v |v| in the plane",
        ("dqr",),
        lambda s: 1 / s.amplitude,
        0.02,
        "positive",
        on_request=True,
    ),
    "sense_gain": Law("sense", "sense gain of y beside that of x", ("gy",), _one, 0.2, weight=3.0),
    "sense_cross_coupling": Law("sense", "each axis senses some of the other", ("ex", "ey"), _one, 0.1, weight=3.0),
    "sense_quadratic": Law(
        "sense", "quadratic sense characteristic", ("a2x", "a2y"), lambda s: 1 / s.amplitude, 0.1, weight=3.0
    ),
    "sense_cubic": Law(
        "sense", "cubic sense characteristic", ("a3x", "a3y"), lambda s: 1 / s.amplitude**2, 0.1, weight=3.0
    ),
    "sense_clipping": Law(
        "sense",
        "sense chain that saturates inside its range",
        ("clx", "cly"),
        _one,
        0.9,
        "positive",
        lambda rng, s: {"level": s.peak * rng.uniform(0.75, 0.93)},
        weight=3.0,
    ),
    "drive_feedthrough": Law(
        "leak", "drive seen by the sense electrodes", ("fdx", "fdy"), lambda s: 1 / s.w**2, 4.0, weight=3.0
    ),
    "parasitic_mode": Law(
        "leak",
        "another mode, driven and seen",
        ("rx", "ry"),
        _one,
        6.0,
        parameters=lambda rng, s: {"mode_w": _away(rng, s, 0.4, 4.5), "mode_zeta": 10 ** rng.uniform(-2.7, -1.5)},
        weight=2.0,
    ),
    "sense_delay": Law("late", "readings that are late", ("tsx", "tsy"), lambda s: s.ts, 0.9, "positive", weight=3.0),
    "drive_delay": Law("late", "drives that act late", ("tux", "tuy"), lambda s: s.ts, 0.9, "positive", weight=3.0),
    "sense_low_pass": Law(
        "late", "low-pass pole in the sense path", ("tlx", "tly"), lambda s: 1 / s.w, 0.3, "positive", weight=3.0
    ),
    "sense_high_pass": Law(
        "late", "high-pass of a charge amplifier", ("hpx", "hpy"), lambda s: s.w, 0.2, "positive", weight=3.0
    ),
    "drive_gain": Law("drive", "drive gain of each axis", ("hx", "hy"), _one, 0.3, weight=3.0),
    "drive_misalignment": Law("drive", "each drive pushes the other axis too", ("mx", "my"), _one, 0.3, weight=2.0),
    "electrostatic_drive": Law(
        "drive", "force with the square of the drive", ("qx", "qy"), lambda s: 1 / s.drive_rms, 0.4, weight=2.0
    ),
    "drive_saturation": Law(
        "drive",
        "amplifier that stops short of what is commanded",
        ("sx", "sy"),
        _one,
        0.9,
        "positive",
        lambda rng, s: {"limit": s.drive_quantile(rng.uniform(0.6, 0.9))},
        weight=3.0,
    ),
    "drive_dead_band": Law(
        "drive",
        "small drives do nothing",
        ("zx", "zy"),
        _one,
        0.9,
        "positive",
        lambda rng, s: {"band": s.drive_quantile(rng.uniform(0.2, 0.6))},
        weight=3.0,
    ),
    "interference": Law(
        "line",
        "line of another source in the readings",
        ("lcx", "lsx", "lcy", "lsy"),
        lambda s: s.amplitude,
        0.05,
        parameters=lambda rng, s: {"line_w": _away(rng, s, 0.1, 5.0)},
        weight=2.0,
    ),
    "base_vibration": Law(
        "line",
        "base that shakes at one frequency",
        ("bcx", "bsx", "bcy", "bsy"),
        lambda s: s.w**2 * s.amplitude,
        0.05,
        parameters=lambda rng, s: {"base_w": _away(rng, s, 0.2, 3.0)},
        weight=2.0,
    ),
    "temperature_stiffness": Law(
        "warmth", "stiffness that moves with the temperature", ("ktx", "kty", "ktxy"), _stiffness, 0.001
    ),
    "temperature_damping": Law(
        "warmth", "damping that moves with the temperature", ("dtx", "dty", "dtxy"), lambda s: s.w, 2e-4
    ),
    "temperature_offset": Law(
        "warmth", "sense offset that moves with the temperature", ("ptx", "pty"), lambda s: s.amplitude, 0.03
    ),
}

SINGLE_TONE = (
    "cubic_stiffness",
    "quadratic_stiffness",
    "dry_friction",
    "drag",
    "damping_asymmetric",
    "nonlinear_damping",
    "sense_gain",
    "sense_cross_coupling",
    "sense_quadratic",
    "sense_cubic",
    "sense_clipping",
    "interference",
    "base_vibration",
)

OUTSIDE: dict[str, Law] = {
    "self_heating": Law(
        "outside",
        "stiffness that falls by heat_k times the heat of the motion, v² behind a lag of heat_tau, 1 at the amplitude",
        ("heat_k",),
        _stiffness,
        0.02,
        "positive",
        lambda rng, s: {"heat_vv": (s.w * s.amplitude) ** 2, **_lag("heat_tau", 20.0, 300.0)(rng, s)},
    ),
    "wake": Law(
        "outside",
        "aerodynamic memory: force -wake_c w, where w follows v |v| behind a lag of wake_tau",
        ("wake_c",),
        lambda s: 1 / s.amplitude,
        0.05,
        "positive",
        _lag("wake_tau", 0.1, 0.6),
    ),
    "ageing_gain": Law(
        "outside",
        "sense gain of y that creeps by aging_g with a time constant of aging_tau after power-on",
        ("aging_g",),
        _one,
        0.2,
        parameters=lambda rng, s: {"aging_tau": s.duration * rng.uniform(0.15, 0.5)},
    ),
    "crossover": Law(
        "outside",
        "crossover of a push-pull amplifier in both sense channels: -cross_c tanh(x/cross_w)",
        ("cross_c",),
        lambda s: s.amplitude,
        0.06,
        "positive",
        lambda rng, s: {"cross_w": s.amplitude * 10 ** rng.uniform(-1.7, -0.9)},
    ),
    "nonlinear_converter": Law(
        "outside",
        "ripple of the converter's characteristic on both channels: inl_a sin(inl_w s), s the reading in m",
        ("inl_a",),
        lambda s: s.amplitude,
        0.03,
        parameters=lambda rng, s: {"inl_w": 2 * math.pi / (s.amplitude * rng.uniform(0.15, 0.5))},
    ),
    "hum_on_bias": Law(
        "outside",
        "stiffness of both axes that hum on the bias modulates: pump_k cos(pump_w t)",
        ("pump_k",),
        _stiffness,
        0.03,
        parameters=lambda rng, s: {"pump_w": s.w * rng.uniform(0.02, 0.3)},
    ),
    "charge_traps": Law(
        "outside",
        "stiffness of x that switches by ±trap_k at uneven times",
        ("trap_k",),
        _stiffness,
        0.01,
        "positive",
        lambda rng, s: {"trap_w": s.w / rng.uniform(150.0, 600.0)},
    ),
    "soft_stop": Law(
        "outside",
        "round stop at stop_gap, touched at the peaks: force -stop_k (r - stop_gap)^1.5",
        ("stop_k",),
        lambda s: s.w**2 / math.sqrt(s.amplitude),
        3.0,
        "positive",
        lambda rng, s: {"stop_gap": s.amplitude * rng.uniform(0.85, 1.0)},
    ),
    "sagging_supply": Law(
        "outside",
        "drive gain that sags by sag_a times the mean square of the drive behind a lag of sag_tau",
        ("sag_a",),
        _one,
        0.25,
        "positive",
        lambda rng, s: {"sag_uu": s.drive_rms**2 * 2, **_lag("sag_tau", 20.0, 200.0)(rng, s)},
    ),
}
