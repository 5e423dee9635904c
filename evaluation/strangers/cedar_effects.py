"""Effects that a record of `cedar` may hide: their coefficients, units and the sizes that a device can have.

Symbols and equations of the effects with a name are those of docs/reference/effects.md; the others are told in a
sentence. Sizes here have no unit: time in 1/omega0, length in the amplitude A. `to_si` gives the unit of the page.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

#: A symbol's unit as exponents of length and of time.
Unit = tuple[int, int]


@dataclass(frozen=True)
class Effect:
    """An effect: `sized` symbols are linear in its size; `drawn` symbols are between two bounds.

    `guess` and `cap` are the first and the largest size of the first symbol; `floor` the smallest one. A bound of a
    drawn symbol counts in units of `scale`: 1, the peak of the drive, or the peak of what a channel shows.
    """

    sized: dict[str, Unit]
    guess: float
    cap: float
    drawn: dict[str, tuple[Unit, float, float]] = field(default_factory=dict)
    scale: str = "one"
    positive: bool = False
    single_tone: bool = False
    each_axis: bool = False
    floor: float = 0.0
    told: str = ""

    def draw(self, rng: np.random.Generator, scales: dict[str, float]) -> tuple[dict[str, float], dict[str, float]]:
        """Shares of the sized symbols (the first is one in size) and values of the drawn ones."""
        shares: dict[str, float] = {}
        for place, symbol in enumerate(self.sized):
            share = 1.0 if place == 0 else rng.uniform(0.5, 1.0)
            if not self.positive:
                share *= rng.choice([-1.0, 1.0])
            shares[symbol] = float(share)
        if self.each_axis and len(shares) == 2 and rng.random() < 0.35:
            shares[list(shares)[1]] = 0.0
        values = {}
        for symbol, (_, low, high) in self.drawn.items():
            unit = 1.0 if symbol.startswith(("omega", "zeta")) else scales[self.scale]
            values[symbol] = float(unit * low * (high / low) ** rng.random())
        return shares, values


def to_si(value: float, unit: Unit, amplitude_m: float, omega0: float) -> float:
    """A number without unit as one in m and s; `unit` holds the exponents of m and s."""
    return float(value * amplitude_m ** unit[0] * omega0 ** -unit[1])


_V0: dict[str, tuple[Unit, float, float]] = {"v0": ((1, -1), 0.004, 0.04)}
_LINE: dict[str, tuple[Unit, float, float]] = {"omega": ((0, -1), 1.35, 3.2)}

#: Effects of the catalogue.
NAMED: dict[str, Effect] = {
    "cubic_stiffness": Effect({"k3x": (-2, -2), "k3y": (-2, -2)}, 1e-3, 0.08, single_tone=True),
    "cubic_isotropic": Effect({"k3": (-2, -2)}, 1e-3, 0.08),
    "quadratic_stiffness": Effect({"k2x": (-1, -2), "k2y": (-1, -2)}, 5e-3, 0.1, single_tone=True),
    "nonreciprocal_stiffness": Effect({"kn": (0, -2)}, 1e-3, 0.02),
    "nonlinear_damping": Effect({"d3x": (-2, -1), "d3y": (-2, -1)}, 1e-3, 0.03, positive=True),
    "dry_friction": Effect({"fx": (1, -2), "fy": (1, -2)}, 5e-4, 0.02, _V0, positive=True, single_tone=True),
    "sense_gain": Effect({"gy": (0, 0)}, 5e-3, 0.15),
    "sense_cross_coupling": Effect({"ex": (0, 0), "ey": (0, 0)}, 5e-3, 0.1),
    "sense_quadratic": Effect({"a2x": (-1, 0), "a2y": (-1, 0)}, 3e-3, 0.12, single_tone=True),
    "sense_cubic": Effect({"a3x": (-2, 0), "a3y": (-2, 0)}, 3e-3, 0.12, single_tone=True),
    "drive_feedthrough": Effect({"fdx": (0, 2), "fdy": (0, 2)}, 0.1, 3.0, each_axis=True),
    "drive_gain": Effect({"hx": (0, 0), "hy": (0, 0)}, 0.03, 0.3, each_axis=True),
    "drive_misalignment": Effect({"mx": (0, 0), "my": (0, 0)}, 0.03, 0.3, each_axis=True),
    "damping_asymmetric": Effect({"dax": (0, -1), "day": (0, -1)}, 1e-3, 0.05, positive=True, single_tone=True),
    "drag": Effect({"dqx": (-1, 0), "dqy": (-1, 0)}, 1e-3, 0.03, positive=True),
    "cubic_damping": Effect({"dcx": (-2, 1), "dcy": (-2, 1)}, 1e-3, 0.03, positive=True),
    "sense_delay": Effect({"tsx": (0, 1), "tsy": (0, 1)}, 0.01, 0.14, positive=True, each_axis=True),
    "drive_delay": Effect({"tux": (0, 1), "tuy": (0, 1)}, 0.05, 0.14, positive=True, each_axis=True),
    "dry_friction_asymmetric": Effect({"fax": (1, -2), "fay": (1, -2)}, 1e-3, 0.03, _V0, positive=True),
    "stribeck_friction": Effect(
        {"stx": (1, -2), "sty": (1, -2)}, 1e-3, 0.03, {**_V0, "vs": ((1, -1), 0.08, 0.4)}, positive=True
    ),
    "sense_low_pass": Effect({"tlx": (0, 1), "tly": (0, 1)}, 0.06, 0.3, positive=True, floor=0.02),
    "sense_high_pass": Effect({"hpx": (0, -1), "hpy": (0, -1)}, 0.01, 0.15, positive=True),
    "sense_clipping": Effect(
        {"clx": (0, 0), "cly": (0, 0)},
        0.3,
        1.0,
        {"level": ((1, 0), 0.7, 0.95)},
        "seen",
        positive=True,
        single_tone=True,
    ),
    "parasitic_mode": Effect(
        {"rx": (0, 0), "ry": (0, 0)}, 0.1, 6.0, {"omega": ((0, -1), 1.6, 4.0), "zeta": ((0, 0), 2e-3, 4e-2)}
    ),
    "electrostatic_drive": Effect({"qx": (-1, 2), "qy": (-1, 2)}, 3.0, 40.0),
    "drive_saturation": Effect({"sx": (0, 0), "sy": (0, 0)}, 0.3, 1.0, {"limit": ((1, -2), 0.2, 0.6)}, "drive", True),
    "drive_dead_band": Effect({"zx": (0, 0), "zy": (0, 0)}, 0.3, 1.0, {"band": ((1, -2), 0.05, 0.3)}, "drive", True),
    "interference": Effect(
        {"lcx": (1, 0), "lsx": (1, 0), "lcy": (1, 0), "lsy": (1, 0)}, 3e-3, 0.05, _LINE, single_tone=True
    ),
    "base_vibration": Effect(
        {"bcx": (1, -2), "bsx": (1, -2), "bcy": (1, -2), "bsy": (1, -2)}, 3e-3, 0.1, _LINE, single_tone=True
    ),
    "nonlinear_damping_radial": Effect({"d3r": (-2, -1)}, 1e-3, 0.03, positive=True),
    "drag_radial": Effect({"dqr": (-1, 0)}, 1e-3, 0.03, positive=True),
    "cubic_damping_radial": Effect({"dcr": (-2, 1)}, 1e-3, 0.03, positive=True),
    "dry_friction_radial": Effect({"fr": (1, -2)}, 5e-4, 0.02, _V0, positive=True),
    "quintic_stiffness": Effect({"k5x": (-4, -2), "k5y": (-4, -2)}, 1e-3, 0.08),
    "quintic_isotropic": Effect({"k5r": (-4, -2)}, 1e-3, 0.08),
}

#: Numbers that one physical constant ties: the page's second symbol of each pair has the value of the first.
TIED = {"hpx": "leak_x", "hpy": "leak_y"}

#: Effects of no catalogue.
OUTSIDE: dict[str, Effect] = {
    "self_heating": Effect(
        {"c": (0, -2)}, 2e-3, 0.05, {"tau": ((0, 1), 300.0, 3000.0)},
        told="self-heating: both stiffnesses grow by c z, where z follows (|v|^2 + r^2) by a thermal time constant tau",
    ),
    "soft_amplifier": Effect(
        {"c": (-2, 4)}, -30.0, -400.0, positive=True,
        told="the drive amplifier compresses: force u + c u^3 on each axis",
    ),
    "lagged_drag": Effect(
        {"c": (-1, 0)}, 3e-3, 0.05, {"tau": ((0, 1), 0.4, 3.0)}, positive=True,
        told="aeroelastic memory: a drag c |v| v that follows the motion by a first-order lag tau",
    ),
    "gain_flutter": Effect(
        {"c": (0, 0)}, 5e-3, 0.08, {"omega": ((0, -1), 2e-3, 2e-2)},
        told="the sense gain of y breathes: y (1 + c sin(omega t)), much slower than the vibration",
    ),
    "bristle": Effect(
        {"c": (0, -2)}, 1e-2, 0.1, {"reach": ((1, 0), 0.05, 0.6)}, positive=True,
        told="a bristle in the plane: force -c z with the vector z' = v - |v| z/reach, hysteresis of the radius",
    ),
    "pump": Effect(
        {"c": (0, -2)}, 3e-3, 0.05, {"omega": ((0, -1), 0.13, 0.8)},
        told="the stiffness is pumped: c cos(omega t) on x, half of that on y, t from the first sample",
    ),
    "damping_patch": Effect(
        {"c": (0, -1)}, 3e-3, 0.06, {"width": ((1, 0), 0.1, 0.5)}, positive=True,
        told="a damping that exists near the centre only: -c v exp(-(r/width)^2)",
    ),
    "stop": Effect(
        {"c": (0, -2)}, 3e-3, 0.2, {"gap": ((1, 0), 0.45, 0.8)}, positive=True,
        told="a soft stop on one side of x: -c (x - gap) where x > gap",
    ),
    "charge_step": Effect(
        {"c": (0, -2)}, 1e-4, 0.01, {"at": ((0, 1), 0.2, 0.8)}, "length",
        told="trapped charge: kxx changes by c once, within some cycles around the time at",
    ),
}  # fmt: skip


def parameters() -> list[str]:
    """Names of all parameters of the compiled part, in their order there."""
    base = "kxx kyy kxy dxx dyy dxy h phi_x phi_y force_sd noise_sd adc_lsb adc_full dac_lsb dac_full"
    rate = "rate_mean rate_sine rate_omega rate_phase rate_step rate_at rate_width"
    loop = "omega gain damping energy quadrature virtual dither modulation modulation_omega kd kxy"
    names = [*base.split(), *rate.split(), *(f"loop_{name}" for name in loop.split())]
    for effect, law in {**NAMED, **OUTSIDE}.items():
        names += [f"{effect}_{symbol}" for symbol in (*law.sized, *law.drawn)]
    return names
