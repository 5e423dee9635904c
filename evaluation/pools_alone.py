"""Several records of one oscillator, drawn and solved by SciPy: decays or forced runs, of one axis."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from estimator.record import Record
from estimator.settings import Device, Gain, ObserverSettings, Spread

RATE, NOISE, AMPLITUDE = 400.0, 2e-6, 1e-3
EFFECTS = {
    "cubic_stiffness": "k3x",
    "quadratic_stiffness": "k2x",
    "drag": "dqx",
    "dry_friction": "fx",
    "sense_cubic": "a3x",
}
KINDS = ("effect", "nothing", "load", "another device", "effect under load", "effect, forced")


class Alone(NamedTuple):
    """A pool of one axis: its kind and effect, by name each record with its covariate, device, settings, what the
    covariate is called, and what was drawn of coefficients and slopes.
    """

    kind: str
    effect: str
    records: tuple[tuple[str, Record, float], ...]
    device: Device
    settings: ObserverSettings
    covariate: str | None
    truth: dict[str, float]


def alone(number: int, seed: int) -> Alone:
    """The pool of that number."""
    rng = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    effect = list(EFFECTS)[number % len(EFFECTS)] if kind.startswith("effect") else ""
    k = (2.0 * np.pi * rng.uniform(15.0, 25.0)) ** 2
    d = float(rng.uniform(2.0, 5.0))
    size = {
        "cubic_stiffness": 0.04 * k / AMPLITUDE**2, "quadratic_stiffness": 0.03 * k / AMPLITUDE, "drag": 6.0,
        "dry_friction": 1e-3 * k * AMPLITUDE, "sense_cubic": 0.01 / AMPLITUDE**2, "": 0.0,
    }[effect] * float(rng.uniform(0.5, 1.5))  # fmt: skip
    softer = -0.1 * k if "load" in kind else 0.0
    count = int(rng.integers(3, 7))
    records = []
    for i in range(count):
        load = 0.1 * i
        other = kind == "another device" and i == count // 2
        stiffness = (k + softer * load) * (1.01 if other else 1.0)
        start = AMPLITUDE * float(rng.uniform(0.6, 2.0))
        records.append((f"record {i}", _record(rng, effect, size, stiffness, d, start, forced="forced" in kind), load))
    device = Device(
        sample_rate=RATE, stiffness=(k * float(rng.uniform(0.99, 1.01)),), damping=(1.2 * d,), amplitude=AMPLITUDE,
        sense_gain=(1.0,), noise=(NOISE,),
    )  # fmt: skip
    settings = ObserverSettings(gain=Gain.EKF, spread=Spread(offset=NOISE, drive_gain=0.0))
    truth = ({EFFECTS[effect]: size} if effect else {}) | ({"kxx": softer} if softer else {})
    return Alone(kind, effect, tuple(records), device, settings, "load_kg" if softer else None, truth)


def _record(
    rng: np.random.Generator, effect: str, size: float, k: float, d: float, start: float, *, forced: bool
) -> Record:
    samples = 1000 if forced else 400
    t = np.arange(samples) / RATE
    drive = np.zeros(samples)
    if forced:
        drive = np.repeat(rng.normal(0.0, 0.3 * k * AMPLITUDE, samples // 4), 4)
        start = 0.0
    laws: dict[str, Callable[[float, float], float]] = {
        "cubic_stiffness": lambda x, v: -size * x**3,
        "quadratic_stiffness": lambda x, v: -size * x**2,
        "drag": lambda x, v: -size * abs(v) * v,
        "dry_friction": lambda x, v: -size * float(np.tanh(v / (1e-4 * np.sqrt(k) * AMPLITUDE))),
    }

    def flow(now: float, s: list[float]) -> list[float]:
        # The drive in row m acted over the interval that ends there.
        row = min(int(np.ceil(now * RATE - 1e-9)), samples - 1)
        return [s[1], -k * s[0] - d * s[1] + (laws[effect](s[0], s[1]) if effect in laws else 0.0) + drive[row]]

    if forced:
        states = [np.array([start, 0.0])]
        for row in range(1, samples):
            span = (t[row - 1] + 1e-12, t[row])
            states.append(solve_ivp(flow, span, states[-1], "DOP853", rtol=1e-9, atol=1e-14).y[:, -1])
        x = np.array(states)[:, 0]
    else:
        x = solve_ivp(flow, (0.0, t[-1]), [start, 0.0], "DOP853", t, rtol=1e-9, atol=1e-14).y[0]
    seen = x + (size * x**3 if effect == "sense_cubic" else 0.0) + rng.normal(0.0, NOISE, samples)
    return Record(seen[:, None], drive[:, None, None], np.full(samples, 1.0 / RATE))
