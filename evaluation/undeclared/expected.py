"""From the emulator's definitions to the catalogue's: which effect tracing should name, with which coefficients.

Written from the two definitions, sharing no code with either.  Lengths are those of the declared sense gain G [V/m],
which the emulated board has exactly on x; an effect on the voltage is one on the displacement over G.  The emulator
counts time from the first sample, the observer from one interval before it, where its first prediction starts: a line's
phase differs by ω Ts.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

Table = Mapping[str, Any]


@dataclass(frozen=True)
class Expected:
    """Names that are right (the first one exactly), and coefficients and searched parameters by name, SI."""

    names: tuple[str, ...]
    coefficients: Mapping[str, float]
    parameters: Mapping[str, float] = field(default_factory=dict)


_SAME = {
    # what the emulator states in coefficients of the catalogue
    "cubic_stiffness": ("k3x", "k3y"),
    "cubic_isotropic": ("k3",),
    "quintic_stiffness": ("k5x", "k5y"),
    "quintic_isotropic": ("k5r",),
    "quadratic_stiffness": ("k2x", "k2y"),
    "nonreciprocal_stiffness": ("kn",),
    "nonlinear_damping": ("d3x", "d3y"),
    "dry_friction": ("fx", "fy"),
    "sense_gain": ("gy",),
    "sense_cross_coupling": ("ex", "ey"),
    "sense_quadratic": ("a2x", "a2y"),
    "sense_cubic": ("a3x", "a3y"),
    "sense_delay": ("tsx", "tsy"),
    "drive_gain": ("hx", "hy"),
    "drive_misalignment": ("mx", "my"),
    "drive_delay": ("tux", "tuy"),
    "electrostatic_drive": ("qx", "qy"),
}


def expected(name: str, tables: Sequence[Table], sections: Table, device: Table) -> Expected:
    """What is right for the drawn effect `name`; `device` as in truth.json."""
    gain = device["gain_V_per_m"]
    if name == "sense_high_pass":
        feedback_F = 2.0 * 5.0 * 100.0 * 8.8541878128e-12 / abs(gain)
        x, y = (1.0 / (ohm * feedback_F) for ohm in sections["sense"]["feedback_ohm"])
        return Expected((name,), {"hpx": x, "hpy": y})
    if name == "sense_low_pass":
        x, y = (1.0 / (2.0 * math.pi * corner) for corner in sections["sense"]["low_pass_Hz"])
        return Expected((name,), {"tlx": x, "tly": y})
    if not tables:
        return Expected((), {})  # a noise, set in a section of its own
    c = tables[0]
    if name in _SAME:
        return Expected((name,), {symbol: c.get(symbol, 0.0) for symbol in _SAME[name]})
    if name == "dry_friction_asymmetric":
        # The catalogue has it in two parts; the second is a constant force but for the turning points.
        symmetric = {"fx": c["fx"], "fy": c["fy"]}
        return Expected(("dry_friction", name), symmetric | {"fax": c["fx"] * c["ax"], "fay": c["fy"] * c["ay"]})
    if name == "drive_feedthrough":
        return Expected((name,), {"fdx": c["gamma_x"] / gain, "fdy": c["gamma_y"] / gain})
    if name in ("interference", "base_vibration"):
        letter, unit = ("l", gain) if name == "interference" else ("b", 1.0)
        omega = 2.0 * math.pi * c["frequency"]
        waves = {}
        for axis in "xy":
            phase = c[f"phase_{axis}"] - omega / device["sample_rate_Hz"]
            waves[f"{letter}s{axis}"] = c[f"a{axis}"] * math.cos(phase) / unit
            waves[f"{letter}c{axis}"] = c[f"a{axis}"] * math.sin(phase) / unit
        return Expected((name,), waves, {"omega": omega})
    if name == "sense_clipping":
        return Expected((name,), {"clx": 1.0, "cly": 1.0}, {"level": c["limit_x"] / abs(gain)})
    if name == "parasitic_mode":
        searched = {"omega": 2.0 * math.pi * c["frequency"], "zeta": c["zeta"]}
        return Expected((name,), {"rx": c["rx"], "ry": c["ry"]}, searched)
    if name == "drive_saturation":
        return Expected((name,), {"sx": 1.0, "sy": 1.0}, {"limit": c["limit_x"]})
    if name == "drive_dead_band":
        return Expected((name,), {"zx": 1.0, "zy": 1.0}, {"band": c["width_x"]})
    if name == "temperature_stiffness":
        kxx, kyy, kxy = device["stiffness_per_s2"]
        return Expected((name,), {"ktx": c["tc"] * kxx, "kty": c["tc"] * kyy, "ktxy": c["tc"] * kxy})
    if name == "temperature_damping":
        dxx, dyy, dxy = device["damping_per_s"]
        return Expected((name,), {"dtx": c["tc"] * dxx, "dty": c["tc"] * dyy, "dtxy": c["tc"] * dxy})
    if name == "temperature_offset":
        return Expected((name,), {"ptx": c["tc_x"] / gain, "pty": c["tc_y"] / gain})
    return Expected((), {})  # outside the catalogue, or nothing to name
