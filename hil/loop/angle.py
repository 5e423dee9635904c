"""The angle that a run reports, row by row: which one it is, its standard uncertainty, and where it means something."""

import math
from typing import Any, Literal

import numpy as np

from estimator.uncertainty import Course, total_variance
from hil.bench import Bench
from hil.declared import calibration_of

Number = Any  # a float, or an array (n,)
Kind = Literal["pattern", "rate", "none"]


def kind_of_angle(bench: Bench) -> Kind:
    """What the reported angle is: the pattern's less the forces', the integrated rate, or none at all.

    In open loop nothing makes an ideal oscillator of the device, and its pattern turns by itself. With the parameters
    known (the observer of 7 states) the integrated rate is an angle; estimated beside it, they take their part of it.
    """
    if bench.device.axes == 1:
        return "none"
    if bench.controller.enabled:
        return "pattern"
    return "rate" if bench.observer.variant == "sense" else "none"


class ReportedAngle:
    """The reported angle of one run; told its rows in order."""

    def __init__(self, bench: Bench) -> None:
        self.kind = kind_of_angle(bench)
        self._limits = bench.limits
        self._calibration = calibration_of(bench)
        self._angular_gain = bench.device.calibration.angular_gain
        self._driven = 1.0 if bench.controller.enabled else 0.0
        self._reference_s = bench.loop.settle_s
        self._referred = False
        self._zero: tuple[float, float, float] | None = None  # t, angle and forced where the angle counts as known

    def valid(self, energy: Number, quadrature: Number) -> Number:
        """Whether the ellipse has the energy and is slender enough for its angle to mean something."""
        limits = self._limits
        slender = (abs(quadrature) <= limits.quadrature) & (abs(energy - 1.0) <= limits.energy_error)
        return slender & (self.kind != "none")

    def uncertainty(
        self,
        t_s: Number,
        angle: Number,
        forced: Number,
        deviation: Number,
        stiffness_xy: Number,
        damping: tuple[Number, Number, Number],
    ) -> Number:
        """Standard uncertainty of the angle's change since the start of the scored window, before it since the first
        row, at bench time t_s: for the angle, what was taken off of it for forces, the deviation by estimation, and the
        constants as estimated there. Numbers, or arrays (n,) in order.
        """
        if not isinstance(t_s, np.ndarray):
            if self._zero is None or (not self._referred and t_s >= self._reference_s):
                self._refer(t_s, angle, forced)
            return self._since(t_s, angle, forced, deviation, stiffness_xy, damping)
        if self._zero is None:
            self._refer(t_s[0], angle[0], forced[0])
        before = self._since(t_s, angle, forced, deviation, stiffness_xy, damping)
        if self._referred or t_s[-1] < self._reference_s:
            return before
        begin = int(np.searchsorted(t_s, self._reference_s))
        self._refer(t_s[begin], angle[begin], forced[begin])
        after = self._since(t_s, angle, forced, deviation, stiffness_xy, damping)
        return np.where(np.arange(len(t_s)) < begin, before, after)

    def _refer(self, t_s: float, angle: float, forced: float) -> None:
        self._zero = float(t_s), float(angle), float(forced)
        self._referred = bool(t_s >= self._reference_s)

    def _since(
        self,
        t_s: Number,
        angle: Number,
        forced: Number,
        deviation: Number,
        stiffness_xy: Number,
        damping: tuple[Number, Number, Number],
    ) -> Number:
        assert self._zero is not None
        start_s, angle_zero, forced_zero = self._zero
        xx, yy, xy = damping
        course = Course(
            seconds=t_s - start_s,
            rotation=angle - angle_zero,
            forced=(forced - forced_zero) * self._driven,
            stiffness_xy=stiffness_xy * self._driven,
            damping=(xx * self._driven, yy * self._driven, xy * self._driven),
            angular_gain=self._angular_gain,
        )
        try:
            return (deviation**2 + total_variance(self._calibration, course)) ** 0.5
        except OverflowError:  # of plain numbers, when the observer diverged
            return math.inf
