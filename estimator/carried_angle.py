"""The angle while the motion is found anew: carried on by the rate, the only thing that still tells of it.

Over a stretch whose drive nobody knows, or after which the motion is no longer known, a force may have turned the
pattern, and a state that is still being found turns by itself.  How far the pattern has turned then tells nothing of
the board.  So the angle goes on by ∫Ω̂ dt, and what the pattern turned by beyond that counts as forced, until the
pattern is known better than what has been carried on.

The angle's error goes with that of the rate, φ̃(t) = φ̃(0) + t Ω̃, and corrections of the motion have no part in it.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.scaling import Array


class CarriedAngle:
    """From the instant of `memory` (1,) on, an observer's; `states`: positions and velocities; `rate`: row of the rate
    in the covariance, -1 where it is not estimated; `turns`: of the board for one of the pattern.
    """

    def __init__(self, memory: NDArray[np.void], states: int, rate: int, turns: float) -> None:
        self._rate, self._turns = rate, turns
        at = memory[0]
        self._angle = float(at["theta_zero"] - at["theta"] + at["forced"] - at["rate_integral"])
        self._begin(memory, float(at["angle_variance"]), at["angle_cross"].copy())
        self._cross[:states] = 0.0  # the motion's error is a new one

    def _begin(self, memory: NDArray[np.void], variance: float, cross: Array) -> None:
        self._time, self._referred = float(memory["time"][0]), int(memory["referred"][0])
        self._variance, self._cross = variance, cross

    def follow(self, memory: NDArray[np.void], rows: NDArray[np.void], covariance: Array) -> bool:
        """Put the carried angle into the output rows (n,) of the newest samples, and into `memory` behind them; whether
        the pattern is known well enough by then to be followed again.

        covariance (k, k): of states and constants, scaled.
        """
        carried = self._turns * self._angle + rows["angle_rate_integral"]
        moved = carried - rows["angle"]
        rows["angle"] = carried
        rows["angle_forced"] -= moved
        memory["forced"] += moved[-1] / self._turns
        if int(memory["referred"][0]) != self._referred:  # it counts from here
            self._begin(memory, 0.0, np.zeros_like(self._cross))
        added = self._add(memory, covariance)
        rows["angle_variance"] = self._turns**2 * float(memory["angle_variance"][0])
        gradient = memory["gradient"][0, : len(covariance)]
        of_pattern = float(gradient @ covariance @ gradient)
        return 0.0 < of_pattern <= added

    def _add(self, memory: NDArray[np.void], covariance: Array) -> float:
        """Variance and covariances of the angle behind the newest sample, into `memory`; what they were raised by."""
        time = float(memory["time"][0]) - self._time
        cross, added = self._cross.copy(), 0.0
        if self._rate >= 0:
            of_rate = covariance[self._rate]
            added = time * (2.0 * self._cross[self._rate] + time * of_rate[self._rate])
            cross[: len(of_rate)] += time * of_rate
        memory["angle_variance"] = self._variance + added
        memory["angle_cross"] = cross
        return float(added)
