"""Every effect beside its law, written out in SI: a sign or a unit that is wrong in a declaration is another law.

Sources are those of the declarations; here the laws are as a textbook has them, per unit mass.
"""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

from estimator.effects.catalogue import EFFECTS
from estimator.effects.declaration import Source
from estimator.model.gyro import dxx, dxy, dyy, kxx, kxy, kyy, phi_x, phi_y, rate, ux, uy, vx, vy, x, y

A, OMEGA0 = 3e-5, 2.0 * np.pi * 700.0
"""The units of a scaled observer: m, rad/s."""

AT = SimpleNamespace(x=2.1e-5, vx=0.071, y=-1.3e-5, vy=-0.053, ux=310.0, uy=-190.0)
"""Where the laws are asked: m, m/s, m/s². Velocities are far from where friction turns over."""

RATE, KXX, KYY, KXY, DXX, DYY, DXY = 7.0, 1.9e7, 2.0e7, 3e5, 4.0, 5.0, 0.6
"""Of the base model: rad/s, 1/s², 1/s."""

SIGNALS = {"warmth": (7.0, 0, 0), "cosine": (0.6, 0, 0), "sine": (-0.8, 0, 0), "directionx": (1.0, 0, 0)}
SIGNALS |= {"directiony": (-1.0, 0, 0), "wane_x": (0.4, 0, 0), "wane_y": (0.3, 0, 0)}
SIGNALS |= {"px": (4e-6, 1, 0), "py": (5e-6, 1, 0)}
LAGGED = {"ux_behind_x": 280.0, "uy_behind_x": -170.0, "ux_behind_y": 260.0, "uy_behind_y": -150.0}
SIGNALS |= {name: (value, 1, -2) for name, value in LAGGED.items()}
SUMMED = {"ux_over_x": 0.062, "uy_over_x": -0.041, "ux_over_y": 0.057, "uy_over_y": -0.045}
SIGNALS |= {name: (value, 1, -1) for name, value in SUMMED.items()}
SIGNALS |= {"slipx": (1.3e-5, 1, 0), "slipy": (-0.7e-5, 1, 0), "time": (3e-4, 0, 1)}
SIGNALS |= {"stopx": (-0.9e-5, 1, 0), "stopy": (0.4e-5, 1, 0)}
SIGNALS |= {"start_x": (0.02, 0, 0), "start_y": (0.03, 0, 0)}
"""By symbol: value in SI, powers of metre and second. K; displacement of a mode; drive behind a lag, drive summed over
time.
"""

Law = Callable[[SimpleNamespace, SimpleNamespace, SimpleNamespace], tuple[float, float]]

FORCES: dict[str, Law] = {
    "nonlinear_damping": lambda s, c, g: (-c.d3x * s.x**2 * s.vx, -c.d3y * s.y**2 * s.vy),
    "dry_friction": lambda s, c, g: (-c.fx * np.sign(s.vx), -c.fy * np.sign(s.vy)),
    "stribeck_friction": lambda s, c, g: (
        -c.stx * np.exp(-((s.vx / g.vs) ** 2)),
        c.sty * np.exp(-((s.vy / g.vs) ** 2)),
    ),
    "nonlinear_damping_radial": lambda s, c, g: (
        -c.d3r * (s.x**2 + s.y**2) * s.vx,
        -c.d3r * (s.x**2 + s.y**2) * s.vy,
    ),
    "drag_radial": lambda s, c, g: (-c.dqr * np.hypot(s.vx, s.vy) * s.vx, -c.dqr * np.hypot(s.vx, s.vy) * s.vy),
    "cubic_damping_radial": lambda s, c, g: (
        -c.dcr * (s.vx**2 + s.vy**2) * s.vx,
        -c.dcr * (s.vx**2 + s.vy**2) * s.vy,
    ),
    "dry_friction_radial": lambda s, c, g: (
        -c.fr * s.vx / np.hypot(s.vx, s.vy),
        -c.fr * s.vy / np.hypot(s.vx, s.vy),
    ),
    "damping_asymmetric": lambda s, c, g: (-c.dax * abs(s.vx), -c.day * abs(s.vy)),
    "drag": lambda s, c, g: (-c.dqx * s.vx * abs(s.vx), -c.dqy * s.vy * abs(s.vy)),
    "cubic_damping": lambda s, c, g: (-c.dcx * s.vx**3, -c.dcy * s.vy**3),
    "dry_friction_asymmetric": lambda s, c, g: (-c.fax, -c.fay),
    "cubic_stiffness": lambda s, c, g: (-c.k3x * s.x**3, -c.k3y * s.y**3),
    "cubic_isotropic": lambda s, c, g: (-c.k3 * s.x * (s.x**2 + s.y**2), -c.k3 * s.y * (s.x**2 + s.y**2)),
    "quintic_stiffness": lambda s, c, g: (-c.k5x * s.x**5, -c.k5y * s.y**5),
    "quintic_isotropic": lambda s, c, g: (
        -c.k5r * s.x * (s.x**2 + s.y**2) ** 2,
        -c.k5r * s.y * (s.x**2 + s.y**2) ** 2,
    ),
    "quadratic_stiffness": lambda s, c, g: (-c.k2x * s.x**2, -c.k2y * s.y**2),
    "nonreciprocal_stiffness": lambda s, c, g: (-c.kn * s.y, c.kn * s.x),
    "hysteretic_stiffness": lambda s, c, g: (-c.khx * 1.3e-5, c.khy * 0.7e-5),
    "play": lambda s, c, g: (c.kpx * 0.9e-5, -c.kpy * 0.4e-5),
    "constant_force": lambda s, c, g: (c.ax, c.ay),
    "drive_gain": lambda s, c, g: (c.hx * s.ux, c.hy * s.uy),
    "drive_misalignment": lambda s, c, g: (c.mx * s.uy, c.my * s.ux),
    "electrostatic_drive": lambda s, c, g: (c.qx * s.ux**2, c.qy * s.uy**2),
    "drive_saturation": lambda s, c, g: tuple(
        share * (np.clip(u, -g.limit, g.limit) - u) for share, u in ((c.sx, s.ux), (c.sy, s.uy))
    ),
    "drive_dead_band": lambda s, c, g: tuple(-z * np.clip(u, -g.band, g.band) for z, u in ((c.zx, s.ux), (c.zy, s.uy))),
    "base_vibration": lambda s, c, g: (c.bcx * 0.6 - c.bsx * 0.8, c.bcy * 0.6 - c.bsy * 0.8),
    "clock_rate": lambda s, c, g: (
        (1.02**2 - 1) * (s.ux - KXX * s.x - KXY * s.y) - 0.02 * (DXX * s.vx + DXY * s.vy),
        (1.02**2 - 1) * (s.uy - KXY * s.x - KYY * s.y) - 0.02 * (DXY * s.vx + DYY * s.vy),
    ),
    # What the forces on y do over 1.25 masses, less what they do over one.
    "unequal_masses": lambda s, c, g: (
        0.0,
        (1 / 1.25 - 1) * (s.uy - KXY * s.x - KYY * s.y - DXY * s.vx - DYY * s.vy - 2 * RATE * s.vx),
    ),
    "drive_polarity": lambda s, c, g: (-2 * s.ux, 0.0),
    # The symmetric matrices k(T) and d(T), 7 K from where they began.
    "temperature_stiffness": lambda s, c, g: tuple(
        -7.0 * np.array([[c.ktx, c.ktxy], [c.ktxy, c.kty]]) @ np.array([s.x, s.y])
    ),
    "temperature_damping": lambda s, c, g: tuple(
        -7.0 * np.array([[c.dtx, c.dtxy], [c.dtxy, c.dty]]) @ np.array([s.vx, s.vy])
    ),
}


def settled(lag: float, s: SimpleNamespace, ux: float, uy: float) -> np.ndarray:
    """[x, ẋ, y, ẏ] behind the lag T: q + T q̇ = s with ṡ = A s + B u is (I + T A)⁻¹ (s − T B l), l the drive behind
    it.
    """
    kxx, kyy = KXX - RATE**2, KYY - RATE**2
    a = np.array([[0, 1, 0, 0], [-kxx, -DXX, -KXY, 2 * RATE - DXY], [0, 0, 0, 1], [-KXY, -2 * RATE - DXY, -kyy, -DYY]])
    now = np.array([s.x, s.vx - lag * ux, s.y, s.vy - lag * uy])
    return np.linalg.solve(np.eye(4) + lag * a, now)


SENSES: dict[str, Law] = {
    "sense_polarity": lambda s, c, g: (-2 * s.x, 0.0),
    "sense_gain": lambda s, c, g: (0.0, c.gy * s.y),
    "sense_cross_coupling": lambda s, c, g: (c.ex * s.y, c.ey * s.x),
    "sense_quadratic": lambda s, c, g: (c.a2x * s.x**2, c.a2y * s.y**2),
    "sense_cubic": lambda s, c, g: (c.a3x * s.x**3, c.a3y * s.y**3),
    "drive_feedthrough": lambda s, c, g: (c.fdx * s.ux, c.fdy * s.uy),
    "sense_low_pass": lambda s, c, g: (
        settled(c.tlx, s, LAGGED["ux_behind_x"], LAGGED["uy_behind_x"])[0] - s.x + c.olx * 0.02,
        settled(c.tly, s, LAGGED["ux_behind_y"], LAGGED["uy_behind_y"])[2] - s.y + c.oly * 0.03,
    ),
    # A leaking integral is its corner's low-pass over that corner.
    "sense_high_pass": lambda s, c, g: (
        -c.hpx / g.leak_x * settled(1 / g.leak_x, s, g.leak_x * SUMMED["ux_over_x"], g.leak_x * SUMMED["uy_over_x"])[0]
        + c.odx * 0.4,
        -c.hpy / g.leak_y * settled(1 / g.leak_y, s, g.leak_y * SUMMED["ux_over_y"], g.leak_y * SUMMED["uy_over_y"])[2]
        + c.ody * 0.3,
    ),
    # A phasor that turns and dies away, 0.3 ms after the first sample; V of an amplitude.
    "free_mode": lambda s, c, g: tuple(
        A * ((a - 1j * b) * np.exp((1j * c.wm - 0.5 * c.dm) * 3e-4)).real for a, b in ((c.cmx, c.smx), (c.cmy, c.smy))
    ),
    "parasitic_mode": lambda s, c, g: (c.rx * 4e-6, c.ry * 5e-6),
    "interference": lambda s, c, g: (c.lcx * 0.6 - c.lsx * 0.8, c.lcy * 0.6 - c.lsy * 0.8),
    "temperature_offset": lambda s, c, g: (c.ptx * 7.0, c.pty * 7.0),
}

# Where the drive or the displacement is beyond the threshold on x and within it on y, or the other way.
GIVEN = {
    "limit": (250.0, 1, -2),
    "band": (250.0, 1, -2),
    "level": (1.7e-5, 1, 0),
    "v0": (1e-5, 1, -1),
    "vs": (0.06, 1, -1),
}
GIVEN |= {"leak_x": (90.0, 0, -1), "leak_y": (130.0, 0, -1)}
GIVEN |= {"delta": (0.02, 0, 0), "m": (0.25, 0, 0), "px": (1.0, 0, 0), "py": (0.0, 0, 0)}

SENSES["sense_clipping"] = lambda s, c, g: tuple(
    share * (np.clip(q, -g.level, g.level) - q) for share, q in ((c.clx, s.x), (c.cly, s.y))
)


def scaled(value: float, length: int, time: int) -> float:
    return value / (A**length * OMEGA0**-time)


def by_declaration(effect, what: str, c: dict[str, float]) -> tuple[float, float]:
    """The declared expressions in SI: scaled, asked, and scaled back."""
    values = {x: (AT.x, 1, 0), vx: (AT.vx, 1, -1), y: (AT.y, 1, 0), vy: (AT.vy, 1, -1), ux: (AT.ux, 1, -2)}
    values |= {uy: (AT.uy, 1, -2), phi_x: (0.0, 1, 0), phi_y: (0.0, 1, 0)}
    values |= {k.symbol: (c[k.name], k.length, k.time) for k in effect.coefficients}
    values |= {p.symbol: GIVEN[p.name] for p in effect.parameters if p.name in GIVEN}
    values |= {s.symbol: SIGNALS[str(s.symbol)] for s in effect.signals if s.source is not Source.PARAMETER}
    values |= {rate: (RATE, 0, -1), kxx: (KXX, 0, -2), kyy: (KYY, 0, -2), kxy: (KXY, 0, -2)}
    values |= {dxx: (DXX, 0, -1), dyy: (DYY, 0, -1), dxy: (DXY, 0, -1)}
    expressions = [sp.sympify(e) for e in getattr(effect, what)]
    numbers = {symbol: scaled(*value) for symbol, value in values.items()}
    unit = A * OMEGA0**2 if what == "force" else A
    first, second = (float(e.subs(numbers)) * unit for e in expressions)
    return first, second


@pytest.mark.parametrize(
    ("effect", "what"),
    [(e, w) for e in EFFECTS for w in ("force", "sense") if any(part != 0 for part in getattr(e, w))],
    ids=lambda value: getattr(value, "name", value),
)
def test_an_effect_is_its_law(effect, what):
    law = (FORCES if what == "force" else SENSES)[effect.name]
    rng = np.random.default_rng(5)
    units = {k.name: k.plausible * A**k.length * OMEGA0**-k.time for k in effect.coefficients}
    c = {name: float(rng.uniform(0.5, 1.5)) * unit for name, unit in units.items()}
    given = SimpleNamespace(**{name: value for name, (value, _, _) in GIVEN.items()})
    expected = law(AT, SimpleNamespace(**c), given)
    np.testing.assert_allclose(by_declaration(effect, what, c), expected, rtol=1e-6, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize(
    "name",
    [
        "nonlinear_damping",
        "dry_friction",
        "drag",
        "cubic_damping",
        "stribeck_friction",
        "nonlinear_damping_radial",
        "dry_friction_radial",
        "drag_radial",
        "cubic_damping_radial",
    ],
)
def test_a_damping_takes_energy_whichever_way_the_mass_moves(name):
    effect = next(e for e in EFFECTS if e.name == name)
    c = {k.name: k.plausible * A**k.length * OMEGA0**-k.time for k in effect.coefficients}
    fx, fy = by_declaration(effect, "force", c)
    assert fx * AT.vx < 0.0
    assert fy * AT.vy < 0.0


def test_units_are_those_of_the_laws():
    """m/s² over what the coefficient is multiplied by."""
    units = {c.name: c.unit for e in EFFECTS for c in e.coefficients}
    assert (units["dcx"], units["dqx"], units["fx"], units["d3x"]) == ("s/m²", "1/m", "m/s²", "1/(m²·s)")
    assert (units["k3x"], units["k2x"], units["kn"], units["qx"]) == ("1/(m²·s²)", "1/(m·s²)", "1/s²", "s²/m")


def test_a_lost_drive_and_a_dead_band_that_adds_are_refused() -> None:
    """(1 + h) u − z clip(u) at h = z = −1 is clip(u): what a dead band loses is therefore no less than nothing."""
    named = {effect.name: effect for effect in EFFECTS}
    gain, band, limit = (named[name] for name in ("drive_gain", "drive_dead_band", "drive_saturation"))
    two = (
        ux + gain.force[0].subs({gain.coefficients[0].symbol: -1}) + band.force[0].subs(band.coefficients[0].symbol, -1)
    )
    one = ux + limit.force[0].subs(limit.coefficients[0].symbol, 1)
    places = {band.parameters[0].symbol: 0.6, limit.parameters[0].symbol: 0.6}
    for drive in (-1.3, -0.2, 0.4, 2.0):
        assert float(two.subs(places).subs(ux, drive)) == pytest.approx(float(one.subs(places).subs(ux, drive)))
    assert all(c.positive for c in band.coefficients)
