"""A beam with a stiffening spring, solved by SciPy: its motion under a force or on a base that moves."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]

RATE_HZ = 500.0
RESONANCE_HZ = 20.0
STIFFNESS = (2.0 * np.pi * RESONANCE_HZ) ** 2
DAMPING = 3.0
CUBIC = 6.0e8  # 1/(m²·s²): 2 to 4 % of the spring at the amplitudes below
AMPLITUDE_M = 1e-3
DRAG = 20.0  # 1/m: at that amplitude a third of what the damping takes


@dataclass(frozen=True)
class Tones:
    """A sum of sines without a common period, so that its derivatives are known: amplitudes, rad/s, phases."""

    size: Array
    omega: Array
    phase: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator, rms: float, low_Hz: float, high_Hz: float, count: int = 40) -> "Tones":
        """`count` sines between two frequencies with the rms of all together."""
        omega = 2.0 * np.pi * np.sort(rng.uniform(low_Hz, high_Hz, count))
        return cls(np.full(count, rms * np.sqrt(2.0 / count)), omega, rng.uniform(0.0, 2.0 * np.pi, count))

    def derivative(self, t: float | Array, order: int = 0) -> Array:
        """The `order`-th derivative by time at t, in the shape of t."""
        angle = np.multiply.outer(t, self.omega) + self.phase + 0.5 * np.pi * order
        return np.asarray(np.sin(angle) @ (self.size * self.omega**order))


@dataclass(frozen=True)
class Moved:
    """Time [s], and displacement, velocity and acceleration [SI] beside the base."""

    t: Array
    x: Array
    v: Array
    a: Array


def moved(
    push: Callable[[float], float],
    seconds: float,
    start: tuple[float, float] = (0.0, 0.0),
    *,
    rate_Hz: float = RATE_HZ,
    stiffness: float = STIFFNESS,
    damping: float = DAMPING,
    cubic: float = CUBIC,
) -> Moved:
    """ẍ = push(t) − k x − d ẋ − k3 x³ [m/s²] from (x, ẋ) on."""

    def slope(t: float, state: Array) -> list[float]:
        x, v = state
        return [v, push(t) - stiffness * x - damping * v - cubic * x**3]

    t = np.arange(round(seconds * rate_Hz)) / rate_Hz
    solved = solve_ivp(slope, (0.0, t[-1]), start, "DOP853", t, rtol=1e-10, atol=1e-14, max_step=0.01)
    x, v = solved.y
    a = np.array([slope(at, state)[1] for at, state in zip(t, solved.y.T, strict=True)])
    return Moved(t, x, v, a)


def amplitude_of(drag: float, seconds: float, start: float) -> tuple[Array, Array]:
    """Times and amplitude [m] of the linear spring's ring-down against damping and `drag` |v| v, where it turns."""

    def slope(t: float, state: Array) -> list[float]:
        x, v = state
        return [v, -STIFFNESS * x - DAMPING * v - drag * abs(v) * v]

    def turns(t: float, state: Array) -> float:
        return float(state[1])

    solved = solve_ivp(slope, (0.0, seconds), (start, 0.0), "DOP853", events=turns, rtol=1e-10, atol=1e-15)
    times, size = solved.t_events[0], np.abs(solved.y_events[0][:, 0])
    once = np.concatenate([[True], np.diff(times) > 0.25 / RESONANCE_HZ])
    return times[once], size[once]
