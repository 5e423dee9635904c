"""Elements with play, drawn: named how often, and how far off; and what a trace that is asked for them says without.

Each device has a single axis of its own frequency, damping and noise; of its element stiffness and half-width are
drawn. Half of the records are decays, the others driven by a dozen sines about the resonance. The board is the emulator
with its own integrator; the bench declares stiffness and damping some per cent off.
"""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.lockstep import scenario_of
from benchmarks.row import Row, Say
from device_emulator.device import TRUTH_COLUMNS
from device_emulator.device import Device as Board
from device_emulator.scenario import Scenario
from estimator.diagnosis import Diagnosis
from estimator.record import Record
from estimator.settings import Device, Gain, ObserverSettings, Spread
from estimator.trace.problem import Problem
from estimator.trace.trace import trace

NAME = "play"
WITH, CLEAN, WITHIN = 24, 12, 12
"""Records with an element that slides, without one, and with one whose half-width is never reached."""
_RATE, _SAMPLES, _MASS = 4000.0, 8000, 1e-3
_AMPLITUDE_M = 1e-4


@dataclass(frozen=True)
class Drawn:
    """A device, SI and per unit mass; kp 0 without an element."""

    frequency_Hz: float
    damping: float
    noise_m: float
    kp: float
    half_width_m: float
    wrong: tuple[float, float]
    driven: bool
    seed: int

    @property
    def stiffness(self) -> float:
        """1/s²."""
        return (2.0 * np.pi * self.frequency_Hz) ** 2


def drawn(number: int, group: str) -> Drawn:
    """The device of that number of a group: "with", "clean" or "within"."""
    rng = np.random.default_rng((20, ("with", "clean", "within").index(group), number))
    frequency = rng.uniform(120.0, 400.0)
    k = (2.0 * np.pi * frequency) ** 2
    width = rng.uniform(0.05, 0.8) if group == "with" else rng.uniform(1.5, 3.0)
    one = Drawn(
        frequency_Hz=frequency,
        damping=rng.uniform(3.0, 15.0),
        noise_m=_AMPLITUDE_M * 10.0 ** rng.uniform(-3.5, -2.5),
        kp=0.0 if group == "clean" else k * 10.0 ** rng.uniform(-2.5, -1.0),
        half_width_m=_AMPLITUDE_M * width,
        wrong=(rng.uniform(0.99, 1.01), rng.uniform(0.7, 1.4)),
        driven=number % 2 == 1,
        seed=number,
    )
    if group != "within":
        return one
    # A half-width beyond whatever the mass does, and the stiffness that the device has there is the one declared.
    stiff = replace(one, half_width_m=1.0)
    reach = float(np.max(np.abs(moved(stiff)[0])))
    return replace(one, half_width_m=width * reach, wrong=(one.wrong[0] * (1.0 + one.kp / one.stiffness), one.wrong[1]))


def moved(one: Drawn) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (n,) of the x axis, m, and what drove it, m/s²."""
    rng, t = np.random.default_rng((21, one.seed)), np.arange(_SAMPLES) / _RATE
    push = np.zeros(_SAMPLES)
    if one.driven:
        sines = 1.0 + rng.uniform(-0.02, 0.02, 12), rng.uniform(0.0, 2.0 * np.pi, 12)
        tones = [np.sin(np.sqrt(one.stiffness) * f * t + p) for f, p in zip(*sines, strict=True)]
        push = np.sum(tones, axis=0)
        push *= 0.02 * one.stiffness * _AMPLITUDE_M / np.std(push)
    full = 2.0 * max(float(np.max(np.abs(push))), 1.0)
    codes = np.zeros((_SAMPLES, 2), np.int32)
    codes[:, 0] = np.round(push / full * 2**15)
    k, d = one.stiffness * _MASS, one.damping * _MASS
    hidden = [{"name": NAME, "kpx": one.kp, "kpy": one.kp, "half_width": one.half_width_m}] if one.kp else []
    table = scenario_of("s-slow").model_dump()
    table["truth"] |= {
        "mass_kg": _MASS,
        "temperature_K": 0.0,
        "stiffness_N_per_m": [k, k, 0.0],
        "damping_N_s_per_m": [d, d, 0.0],
        "position_m": [0.0 if one.driven else _AMPLITUDE_M, 0.0],
        "velocity_mps": [0.0, 0.0],
    }
    table["drive"] |= {"noise_mps2_per_rtHz": 0.0, "full_scale_mps2": full, "dac_bits": 16}
    table |= {"rate": {"kind": "constant", "rate_rad_s": 0.0}, "effect": hidden}
    rows: list[np.ndarray] = []
    board = Board(Scenario.model_validate(table), sink=lambda _, page: rows.append(page.copy()))
    board.rows(codes)
    board.close()
    return np.concatenate(rows)[:, TRUTH_COLUMNS.index("x_m")], full / 2**15 * codes[:, 0]


def recorded(one: Drawn) -> Record:
    """What the x axis shows, with noise, and what drove it."""
    x, push = moved(one)
    seen = x + one.noise_m * np.random.default_rng((22, one.seed)).standard_normal(_SAMPLES)
    return Record(seen[:, None], push[:, None, None], np.full(_SAMPLES, 1.0 / _RATE))


def traced(one: Drawn) -> Diagnosis:
    """The trace that is asked for an element with play."""
    device = Device(
        sample_rate=_RATE,
        stiffness=(one.wrong[0] * one.stiffness,),
        damping=(one.wrong[1] * one.damping,),
        amplitude=_AMPLITUDE_M,
        sense_gain=(1.0,),
        noise=(one.noise_m,),
    )
    settings = ObserverSettings(gain=Gain.EKF, spread=Spread(stiffness=0.02, damping=5.0))
    return trace(Problem(recorded(one), device, settings), split=round(0.6 * _SAMPLES))


def rows(say: Say) -> list[Row]:
    """Of each group what was named, and how far the coefficients are off, in half-widths of their intervals."""
    table: list[Row] = []
    off: list[float] = []
    for group, number in (("with", WITH), ("clean", CLEAN), ("within", WITHIN)):
        seen: Counter[str] = Counter()
        for each in range(number):
            one = drawn(each, group)
            said = traced(one)
            names = [found.name for found in said.effects]
            others = "others" if names else "nothing"
            kind = "only it" if names == [NAME] else "it and more" if NAME in names else others
            seen[kind] += 1
            far = {}
            for found in said.effects:
                if found.name == NAME and group == "with":
                    for symbol, true in (("kpx", one.kp), ("half_width", one.half_width_m)):
                        interval = found.coefficients[symbol]
                        far[symbol] = abs(interval.value - true) / (0.5 * (interval.high - interval.low))
            off += far.values()
            how = "driven" if one.driven else "decay"
            say(
                f"{group} {each} {how} {one.frequency_Hz:.0f} Hz kp/k {one.kp / one.stiffness:.4f} w/A "
                f"{one.half_width_m / _AMPLITUDE_M:.2f} noise {one.noise_m / _AMPLITUDE_M:.1e}: {said.verdict.value} "
                f"{names} " + " ".join(f"{name} {value:.2f}" for name, value in far.items())
            )
        table += [Row(f"play, {group}: {kind} named", count, f"of {number}") for kind, count in sorted(seen.items())]
    inside = float(np.mean(np.array(off) < 1.0))
    return [*table, Row("play: intervals that hold the truth", inside, f"of {len(off)}")]
