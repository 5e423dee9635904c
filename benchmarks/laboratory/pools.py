"""Several records of one beam: decays from other amplitudes, and forced runs under other loads, one file each."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.laboratory.beam import AMPLITUDE_M, CUBIC, DAMPING, RATE_HZ, STIFFNESS, Array, Tones, moved

_DECAY_S, _FORCED_S = 1.2, 2.0
_NOISE_MM = 2e-3
_NOISE_MM_S = 0.25
LOADS_KG = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
SOFTER = 2000.0  # 1/s² of stiffness that a load of 1 kg takes away (an eighth)


@dataclass(frozen=True)
class PoolKind:
    """Columns and map of each file by name, what is held out, the covariate, the sense, and the truth.

    slopes: by constant, its change with one of the covariate.
    """

    name: str
    files: Mapping[str, tuple[Mapping[str, Array], str]]
    held_out: tuple[str, ...]
    covariate: str | None
    sense: Mapping[str, str | float]
    truth: Mapping[str, float]
    slopes: Mapping[str, float]
    rate_Hz: float = RATE_HZ


_SENSE: Mapping[str, str | float] = {"gain_V_per_m": 1e3, "unit": "mm", "noise_V": _NOISE_MM, "offset_sd_V": _NOISE_MM}
_MAP = 'hold = "{hold}"\n{more}\n[columns]\nt_s = {{ column = "t", unit = "s" }}\n{columns}\n'
_SENSOR = 'vx = { column = "sensor", unit = "mm" }'


def decays(rng: np.random.Generator) -> PoolKind:
    """Eight decays from 0.5 to 2 mm; two judge."""
    files = {}
    for number, start in enumerate(AMPLITUDE_M * np.linspace(0.5, 2.0, 8)):
        motion = moved(lambda t: 0.0, _DECAY_S, (float(start), 0.0))
        seen = 1e3 * motion.x + rng.normal(0.0, _NOISE_MM, len(motion.t))
        text = _MAP.format(hold="zoh", more="", columns=_SENSOR)
        files[f"decay-{number}"] = ({"t": motion.t, "sensor": seen}, text)
    return PoolKind("pooled decays", files, ("decay-2", "decay-6"), None, _SENSE, {"k3x": CUBIC}, {})


def loads(rng: np.random.Generator) -> PoolKind:
    """Forced runs under loads of 0 to 0.7 kg, which soften the spring; those of 0.2 and 0.5 kg judge."""
    files = {}
    for number, load in enumerate(LOADS_KG):
        force = Tones.drawn(rng, 4.0, 5.0, 60.0)
        stiffness = STIFFNESS - SOFTER * load

        def push(t: float, force: Tones = force) -> float:
            return float(force.derivative(t))

        motion = moved(push, _FORCED_S, stiffness=stiffness, damping=DAMPING)
        seen = 1e3 * motion.x + rng.normal(0.0, _NOISE_MM, len(motion.t))
        columns = _SENSOR + '\nux_mps2 = { column = "shaker", unit = "m/s^2" }'
        text = _MAP.format(hold="bandlimited", more=f"covariates = {{ load_kg = {load} }}", columns=columns)
        files[f"load-{number}"] = ({"t": motion.t, "sensor": seen, "shaker": force.derivative(motion.t)}, text)
    return PoolKind(
        "covariate", files, ("load-2", "load-5"), "load_kg", _SENSE, {"k3x": CUBIC}, {"kxx": -SOFTER}
    )  # fmt: skip


@dataclass(frozen=True)
class TwoModes:
    """A beam whose first mode softens and drags, and whose second rings beside it: modal coordinates, SI."""

    softening: float = -3.0e8  # 1/(m²·s²): 2 % of the spring at 1 mm, 8 % at 2 mm
    drag: float = 4.0  # 1/m: a sixth of the damping at 1 mm
    second_Hz: float = 63.0
    second_damping: float = 9.0

    @property
    def ringing(self) -> float:
        """Angular frequency of the second mode, rad/s."""
        return float(np.sqrt((2.0 * np.pi * self.second_Hz) ** 2 - 0.25 * self.second_damping**2))

    def velocity(self, t: Array, first: float, second: tuple[float, float]) -> Array:
        """What a vibrometer sees of both, m/s: the first released from there, the second with that displacement and
        velocity.
        """

        def slope(_: float, s: Array) -> list[float]:
            x, v, p, w = s
            mode = -((2.0 * np.pi * self.second_Hz) ** 2) * p - self.second_damping * w
            push = -STIFFNESS * x - DAMPING * v - self.softening * x**3 - self.drag * abs(v) * v
            return [v, push, w, mode]

        begin = (first, 0.0, *second)
        solved = solve_ivp(slope, (0.0, t[-1]), begin, "DOP853", t, rtol=1e-10, atol=1e-14, max_step=2e-3)
        return np.asarray(solved.y[1] + solved.y[3])


def two_modes(rng: np.random.Generator, beam: TwoModes = TwoModes()) -> PoolKind:
    """Twelve decays from 0.5 to 2 mm, seen by a vibrometer, in mm/s; both modes ring, nothing drives; four judge."""
    files, t = {}, np.arange(round(_DECAY_S * RATE_HZ)) / RATE_HZ
    for number, start in enumerate(AMPLITUDE_M * np.linspace(0.5, 2.0, 12)):
        second = (float(start) * rng.uniform(0.05, 0.15), rng.normal(0.0, 0.02))
        seen = 1e3 * beam.velocity(t, float(start), second) + rng.normal(0.0, _NOISE_MM_S, len(t))
        text = _MAP.format(hold="zoh", more="", columns='vx = { column = "sensor", unit = "mm/s" }')
        files[f"ring-{number}"] = ({"t": t, "sensor": seen}, text)
    sense = {**_SENSE, "senses": "velocity", "unit": "mm/s", "noise_V": _NOISE_MM_S, "offset_sd_V": _NOISE_MM_S}
    truth = {"k3x": beam.softening, "dqx": beam.drag, "wm": beam.ringing, "dm": beam.second_damping}
    held_out = ("ring-2", "ring-5", "ring-8", "ring-10")
    return PoolKind("two modes, velocity", files, held_out, None, sense, truth, {})


POOLS: tuple[Callable[[np.random.Generator], PoolKind], ...] = (decays, loads, two_modes)
