"""What the reported angle is uncertain by, source by source: one function, for each row of a run and for its end.

While a run lasts nobody has looked at its record as a whole; the scan that closes it has, and the budget of the end
(`hil.verdict.budget`) puts what the record leaves of a source in the place of what was declared of it.
"""

import math
from typing import Any

from estimator.uncertainty import Calibration, SinceZero, variances
from hil.bench import Bench

Number = Any  # a float, or an array (n,)

ESTIMATION = "estimation"
DAMPING = "declared damping"


def source_of(constant: str) -> str:
    """How a constant of the calibration is called in a budget."""
    return constant.replace("_", " ")


class Sources:
    """The sources of uncertainty of one bench file."""

    def __init__(self, bench: Bench) -> None:
        known = bench.device.known
        self._known = frozenset(known)
        self._calibration = Calibration(**{name: item.u for name, item in known.items()})
        self._angular_gain = bench.device.calibration.angular_gain
        self._held = bench.controller.mode in ("force_to_rebalance", "mode_reversal")
        self._driven = 1.0 if bench.controller.enabled else 0.0
        self.damping_sd_per_s = _damping_sd_per_s(bench)

    def course(
        self, seconds: Number, rotation: Number, forced: Number, stiffness_xy: Number, damping: tuple[Number, ...]
    ) -> SinceZero:
        """What happened since the angle was zero; without control no force turned anything.

        Loops that hold the pattern turn it back by what the board turns.
        """
        xx, yy, xy = (self._driven * each for each in damping)
        return SinceZero(
            seconds=seconds,
            rotation=rotation,
            forced=self._driven * (rotation if self._held else forced),
            stiffness_xy=self._driven * stiffness_xy,
            damping=(xx, yy, xy),
            angular_gain=self._angular_gain,
        )

    def variances(self, deviation: Number, course: SinceZero) -> dict[str, Number]:
        """Variance [rad²] of the angle by each source; deviation [rad]: that by estimation."""
        found = {ESTIMATION: deviation**2}
        each = variances(self._calibration, course)
        found |= {source_of(name): variance for name, variance in each.items() if name in self._known}
        if self.damping_sd_per_s is not None:
            # A quarter of a difference between the axes, √2 of them, for that long.
            rate = 0.25 * math.sqrt(2.0) * self.damping_sd_per_s / course.angular_gain
            found[DAMPING] = (rate * course.seconds) ** 2
        return found


def _damping_sd_per_s(bench: Bench) -> float | None:
    """Of the observer of 7 states, which takes the parameters as known: what it is told of the damping."""
    if bench.observer.variant != "sense" or bench.observer.plugin is not None:
        return None
    return bench.damping_sd_per_s
