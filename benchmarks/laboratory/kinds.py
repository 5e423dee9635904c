"""Each kind of record as the file that a laboratory would have, with its map and its bench file."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.laboratory.beam import (
    AMPLITUDE_M,
    CUBIC,
    DAMPING,
    DRAG,
    RATE_HZ,
    STIFFNESS,
    Array,
    Moved,
    Tones,
    amplitude_of,
    moved,
)

SECONDS = 12.0
NOISE = 2e-3  # of the rms of what is sensed
_G = 9.80665


@dataclass(frozen=True)
class Kind:
    """Columns of the file, the map's text, what [device.sense] and [device] say, and the truth by coefficient."""

    name: str
    columns: Mapping[str, Array]
    map_text: str
    sense: Mapping[str, str | float]
    rate_Hz: float
    truth: Mapping[str, float]


def noisy(rng: np.random.Generator, shown: Array) -> tuple[Array, float]:
    """What a sensor shows, and the noise of it."""
    noise = NOISE * float(np.std(shown))
    return shown + rng.normal(0.0, noise, len(shown)), noise


def _map(columns: str, more: str = "", hold: str = "bandlimited") -> str:
    return f'hold = "{hold}"\n{more}\n[columns]\nt_s = {{ column = "t", unit = "s" }}\n{columns}\n'


def _kind(
    name: str,
    rng: np.random.Generator,
    shown: Array,
    sensed: tuple[str, str, float],
    driven: tuple[str, str, Array],
    t: Array,
) -> Kind:
    """sensed: what, in which unit, and how many of it for one of SI; driven: channel, unit and its column."""
    what, unit, gain = sensed
    seen, noise = noisy(rng, gain * shown)
    channel, drive_unit, drive = driven
    lines = f'vx = {{ column = "sensor", unit = "{unit}" }}\n{channel} = {{ column = "shaker", unit = "{drive_unit}" }}'
    return Kind(
        name,
        {"t": t, "sensor": seen, "shaker": drive},
        _map(lines),
        {"gain_V_per_m": gain, "senses": what, "unit": unit, "noise_V": noise, "offset_sd_V": noise},
        RATE_HZ,
        {"k3x": CUBIC},
    )


def by_force(rng: np.random.Generator) -> tuple[Moved, Array]:
    """The beam under a known force of 5 to 60 Hz, and that force [m/s²]."""
    force = Tones.drawn(rng, 4.0, 5.0, 60.0)
    motion = moved(lambda t: float(force.derivative(t)), SECONDS)
    return motion, force.derivative(motion.t)


def by_base(rng: np.random.Generator) -> tuple[Moved, Tones]:
    """The beam on a base that moves by 5 to 60 Hz, and that motion [m]."""
    base = Tones.drawn(rng, 1.5e-4, 5.0, 60.0)
    return moved(lambda t: -float(base.derivative(t, 2)), SECONDS), base


def velocity(rng: np.random.Generator) -> Kind:
    """A laser vibrometer, mm/s."""
    motion, force = by_force(rng)
    return _kind("velocity", rng, motion.v, ("velocity", "mm/s", 1e3), ("ux_mps2", "m/s^2", force), motion.t)


def acceleration(rng: np.random.Generator) -> Kind:
    """An accelerometer on the mass, g."""
    motion, force = by_force(rng)
    sensed = ("acceleration", "g", 1.0 / _G)
    return _kind("acceleration", rng, motion.a, sensed, ("ux_mps2", "m/s^2", force), motion.t)


def own_unit(rng: np.random.Generator) -> Kind:
    """A strain gauge, µstrain."""
    motion, force = by_force(rng)
    return _kind("strain", rng, motion.x, ("displacement", "µstrain", 3e5), ("ux_mps2", "m/s^2", force), motion.t)


def base_of(order: int) -> Callable[[np.random.Generator], Kind]:
    """A base whose displacement, velocity or acceleration was measured."""
    name = ("displacement", "velocity", "acceleration")[order]
    unit, factor = (("mm", 1e3), ("mm/s", 1e3), ("g", 1.0 / _G))[order]

    def made(rng: np.random.Generator) -> Kind:
        motion, base = by_base(rng)
        driven = ("base", unit, factor * base.derivative(motion.t, order))
        return _kind(f"base {name}", rng, motion.x, ("displacement", "px", 2e4), driven, motion.t)

    return made


def absolute(rng: np.random.Generator) -> Kind:
    """A vibrometer that stands beside the base, mm/s, and the base's displacement."""
    motion, base = by_base(rng)
    seen, noise = noisy(rng, 1e3 * (motion.v + base.derivative(motion.t, 1)))
    lines = 'vx = { column = "sensor", unit = "mm/s", frame = "absolute" }\nbase = { column = "shaker", unit = "mm" }'
    return Kind(
        "absolute velocity",
        {"t": motion.t, "sensor": seen, "shaker": 1e3 * base.derivative(motion.t)},
        _map(lines),
        {"gain_V_per_m": 1e3, "senses": "velocity", "unit": "mm/s", "noise_V": noise, "offset_sd_V": noise},
        RATE_HZ,
        {"k3x": CUBIC},
    )


def filtered(rng: np.random.Generator) -> Kind:
    """Sampled at 5 kHz in noise, with a drift and hum at 700 Hz; passed from 1.5 to 180 Hz, every tenth sample kept.

    The band holds the third harmonics of tones from 5 to 60 Hz, not the slowest differences that a cubic spring makes.
    """
    force = Tones.drawn(rng, 4.0, 5.0, 60.0)
    motion = moved(lambda t: float(force.derivative(t)), SECONDS, rate_Hz=5000.0)
    noise = 1e-2 * float(np.std(motion.x))
    junk = AMPLITUDE_M * (0.5 * np.sin(2 * np.pi * 0.2 * motion.t) + 0.3 * np.sin(2 * np.pi * 700.0 * motion.t))
    seen = 1e3 * (motion.x + junk + rng.normal(0.0, noise, len(motion.t)))
    lines = 'vx = { column = "sensor", unit = "mm" }\nux_mps2 = { column = "shaker", unit = "m/s^2" }'
    return Kind(
        "band-pass, decimated",
        {"t": motion.t, "sensor": seen, "shaker": force.derivative(motion.t)},
        _map(lines) + "\n[filter]\nlow_Hz = 1.5\nhigh_Hz = 180.0\norder = 3\ndecimate = 10\n",
        {"gain_V_per_m": 1e3, "unit": "mm", "noise_V": 1e3 * noise, "offset_sd_V": 1e3 * noise},
        RATE_HZ,
        {"k3x": CUBIC},
    )


def envelope(rng: np.random.Generator) -> Kind:
    """A ring-down as a laboratory's instrument keeps it: the level in dB of 1 µm, fifty times a second."""
    times, size = amplitude_of(DRAG, 3.1, 2.0 * AMPLITUDE_M)
    t = np.arange(0.0, 3.0, 0.02)
    seen = 20.0 * np.log10(1e6 * np.exp(CubicSpline(times, np.log(size))(t))) + rng.normal(0.0, 0.05, len(t))
    return Kind(
        "envelope",
        {"t": t, "sensor": seen},
        _map('vx = { column = "sensor", unit = "dB" }', hold="zoh"),
        {"gain_V_per_m": 1e6, "senses": "envelope", "unit": "dB", "noise_V": 0.05},
        50.0,
        {"dqx": DRAG},
    )


KINDS: tuple[Callable[[np.random.Generator], Kind], ...] = (
    velocity,
    acceleration,
    own_unit,
    base_of(0),
    base_of(1),
    base_of(2),
    absolute,
    filtered,
    envelope,
)


def bench_text(rate_Hz: float, declared: Mapping[str, str | float]) -> str:
    """A bench file: the beam 0.5 % off in stiffness, a fifth in damping, and nothing of the cubic spring."""
    sense = "\n".join(f"{key} = {_toml(value)}" for key, value in declared.items())
    return f"""
[device]
name = "beam"
axes = 1
mass_kg = 1.0
stiffness_N_per_m = [{1.005 * STIFFNESS:.9g}]
damping_N_s_per_m = [{1.2 * DAMPING:.9g}]
amplitude_m = {AMPLITUDE_M:g}
sample_rate_Hz = {rate_Hz:g}

[device.sense]
{sense}

[device.drive]
unit = "mps2"
full_scale = 100.0
hold = "bandlimited"

[loop]
name = "beam"
clock = "lockstep"
duration_s = {SECONDS:g}
settle_s = 1.0

[observer]
variant = "full"
gain = "ekf"

[observer.initial_sd]
position = 2.0
velocity = 2.0
stiffness = 0.05
damping = 1.0

[controller]
enabled = false
"""


def _toml(value: str | float) -> str:
    return f'"{value}"' if isinstance(value, str) else f"{value:.9g}"
