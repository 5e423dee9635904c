"""Gain mode's matrix: what a board that closes the loop itself is told to do with its filtered signals."""

import ctypes
import math
from dataclasses import dataclass

import numpy as np

from estimator.core.arguments import Arguments
from estimator.core.library import LIBRARY
from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.scaling import Array

RADIUS = 0.7
_FOLDING = Arguments("gain_matrix.h", "Folding")
LIBRARY.estimator_gains.argtypes = (ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
_CONDITION = 1e6  # of the signals by the motion; beyond it rounding and noise are all there is


@dataclass(frozen=True)
class BoardFilter:
    """s[m] = A s[m − 1] + B V[m] + C V[m − D] for each axis: `a` 2 × 2, `b` and `c` two numbers, `delay` in samples."""

    a: tuple[tuple[float, float], tuple[float, float]]
    b: tuple[float, float]
    c: tuple[float, float]
    delay: int


def luenberger(step_rad: float, radius: float = RADIUS) -> BoardFilter:
    """Observer of an oscillator that turns by `step_rad` a sample, driven by nothing: (V, V̇/ω0), its poles at
    `radius` exp(± i step_rad).
    """
    cosine, sine = math.cos(step_rad), math.sin(step_rad)
    b = 1.0 - radius**2, (1.0 - radius) ** 2 * cosine / sine
    return BoardFilter(
        a=(((1.0 - b[0]) * cosine, (1.0 - b[0]) * sine), (-b[1] * cosine - sine, cosine - b[1] * sine)),
        b=b,
        c=(0.0, 0.0),
        delay=1,
    )


def pair(delay: int) -> BoardFilter:
    """The codes themselves: V[m] and V[m − delay]."""
    return BoardFilter(((0.0, 0.0), (0.0, 0.0)), (1.0, 0.0), (0.0, 1.0), delay)


class GainMatrix:
    """Folds an observer's estimates and its controller's settings into G and b.

    Of the effects that the observer carries only inverted channels are compensated.  Raises ModelError for a
    filter whose two signals are nearly one at the target frequency.
    """

    def __init__(self, observer: Observer, board: BoardFilter) -> None:
        self._observer, self._board = observer, board
        self._gain = np.zeros((2, 4))
        self._bias = np.zeros(2)
        drives, senses = (_signs(observer, f"{channel}_polarity") for channel in ("drive", "sense"))
        turns = np.outer(drives, np.repeat(senses, 2))
        arrays, signals = observer.arrays, np.zeros((4, 4))
        self._folding = _FOLDING(
            total=len(arrays.x), delay=board.delay, settings=arrays.settings, memory=arrays.memory, x=arrays.x,
            a=(*board.a[0], *board.a[1]), b=board.b, c=board.c, turns=turns, gain=self._gain, bias=self._bias,
            motion=signals,
        )  # fmt: skip
        LIBRARY.gyro_filtered_swing(self._folding)
        if not np.linalg.cond(signals) < _CONDITION:
            raise ModelError(
                f"a filter over {board.delay} samples ({board.delay * observer.h / math.pi:.3g} half cycles) "
                "gives one signal twice; choose a delay near a quarter of a cycle"
            )

    def __reduce__(self) -> tuple[type["GainMatrix"], tuple[Observer, BoardFilter]]:
        return GainMatrix, (self._observer, self._board)  # anew: what the core is handed has addresses

    def solve(self, horizon: int, ahead: int = 0) -> tuple[Array, Array]:
        """(G (2, 4) in drive codes per sense code, b (2,) in drive codes) for the newest estimate; lent until the next
        call.  Zeros where the estimate is not finite.

        `horizon` is the time in samples from the estimate to the end of what it will be used for: a hold does no more
        than a quarter of its work in that time; `ahead` is the time in samples until it comes into force.
        """
        LIBRARY.estimator_gains(self._folding, horizon, ahead)
        return self._gain, self._bias

    @property
    def address(self) -> int:
        """What `estimator_gains` is called with in C; it writes to `newest`."""
        return ctypes.addressof(self._folding.contents)

    @property
    def newest(self) -> tuple[Array, Array]:
        """What was solved last; lent."""
        return self._gain, self._bias


def _signs(observer: Observer, effect: str) -> Array:
    """−1 for each axis that the observer's effect of that name turns round."""
    given = observer.settings.effects.get(effect, {})
    return np.array([1.0 - 2.0 * given.get(name, 0.0) for name in ("px", "py")])
