"""An oscillator with a play element by SciPy, from one event to the next; what tests hold core and emulator to."""

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]


def play(x: Floats, width: float, z: float = 0.0) -> Floats:
    """The play operator on a series (Visintin, Differential Models of Hysteresis, 1994, eq. III.2.1)."""
    found = np.empty_like(x)
    for i, one in enumerate(x):
        z = found[i] = max(one - width, min(one + width, z))
    return found


def integrated(
    k: float, d: float, kp: float, width: float, x0: float, t: Floats, push: Callable[[float], float] = lambda t: 0.0
) -> Floats:
    """Displacement, velocity and foot (3, n) at equidistant times t of ẍ + d ẋ + k x + kp (x − z) = push(t), z the play
    of x, released at x0 that it was drawn to from 0; push is constant between two of t.
    """
    state, hold = np.array([x0, 0.0]), 0
    z = max(x0 - width, min(x0 + width, 0.0))
    rows = [(x0, 0.0, z)]
    for begin, end in itertools.pairwise(t):
        now, force = begin, push(0.5 * (begin + end))
        while now < end:
            held, foot = hold, z

            def slope(_: float, s: Floats, held: int = held, foot: float = foot, force: float = force) -> list[float]:
                stretch = held * width if held else s[0] - foot
                return [s[1], force - k * s[0] - d * s[1] - kp * stretch]

            def turned(_: float, s: Floats, held: int = held) -> float:
                return held * s[1] if held else 1.0

            def caught(_: float, s: Floats, held: int = held, foot: float = foot) -> float:
                return 1.0 if held else width - abs(s[0] - foot)

            turned.terminal = caught.terminal = True  # type: ignore[attr-defined]
            turned.direction = caught.direction = -1.0  # type: ignore[attr-defined]
            run = solve_ivp(slope, (now, end), state, "DOP853", rtol=1e-11, atol=1e-16, events=(turned, caught))
            state, now = run.y[:, -1], run.t[-1]
            if held:
                z = state[0] - held * width
            if run.status == 1:
                hold = 0 if held else (1 if state[0] > foot else -1)
        rows.append((state[0], state[1], z))
    return np.array(rows).T
