"""The angle that a run reports, row by row: counted from its zero, its standard uncertainty, where it means something.

The zero is that of the uncertainty: the first row, and from the start of the scored window on the angle there.  By then
the observer has settled, and what it did not know before is in neither (docs/decisions/0005-reported-angle.md).
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.characteristics.angle_map import Correction, pattern_angle
from hil.bench import Bench
from hil.bench.angle_map import read_angle_map
from hil.inputs.declared import formula_of
from hil.records.table import scored_from_s
from hil.verdict.uncertainty import Sources

Floats = NDArray[np.float64]


class ReportedAngle:
    """The reported angle of one run; told its rows in order."""

    def __init__(self, bench: Bench) -> None:
        self.kind = formula_of(bench).kind
        self._limits = bench.limits
        self._energy_held = bench.controller.enabled
        self._sources = Sources(bench)
        self._bench = bench
        self._zero_s = math.inf  # bench time; known with the first row
        self._scored = False
        self._zero: tuple[float, ...] | None = None  # bench time, then the angles there
        known = bench.device.calibration.angle_map
        self._correction = None if known is None else Correction(read_angle_map(Path(known)).map())

    def calibrated(self, t_s: Floats, motion: Sequence[Floats], angle: Floats, rate: Floats) -> tuple[Floats, Floats]:
        """Angle (n,) and rate (n,) of the next rows without what the bench file's angle map has of them; the motion
        (x, vx, y, vy), (n,) each, tells the pattern's angle."""
        if self._correction is None:
            return angle, rate
        x, vx, y, vy = motion
        theta = pattern_angle(x, vx, y, vy, self._bench.target_stiffness_per_s2)
        return self._correction.follow(t_s, theta, angle, rate)

    def valid(self, energy: Floats, quadrature: Floats) -> NDArray[np.bool_]:
        """Whether (n,) the ellipse is so slender that its angle means something, and has the energy that is held."""
        slender = np.abs(quadrature) <= self._limits.quadrature
        held = np.abs(energy - 1.0) <= self._limits.energy_error if self._energy_held else energy > 0.0
        return np.asarray(slender & held & (self.kind != "none"))

    def follow(
        self,
        t_s: Floats,
        angles: Sequence[Floats],
        deviation: Floats,
        stiffness_xy: Floats,
        damping: tuple[Floats, Floats, Floats],
    ) -> tuple[list[Floats], Floats]:
        """The angles counted from the zero, and the standard uncertainty of the first of them, at bench times t_s (n,),
        in order: of angles since the run began, the reported one, what was taken off of it for forces, and any more;
        the deviation by estimation, and the constants as estimated there.
        """
        if self._zero is None:
            self._zero_s = scored_from_s(float(t_s[0]), self._bench.loop.settle_s, self._bench.device.sample_rate_Hz)
            self._refer(t_s[0], [angle[0] for angle in angles])
        before = self._since(t_s, angles, deviation, stiffness_xy, damping)
        if self._scored or t_s[-1] < self._zero_s:
            return before
        begin = int(np.searchsorted(t_s, self._zero_s))
        self._refer(t_s[begin], [angle[begin] for angle in angles])
        after = self._since(t_s, angles, deviation, stiffness_xy, damping)
        early = np.arange(len(t_s)) < begin
        counted = [np.where(early, *pair) for pair in zip(before[0], after[0], strict=True)]
        return counted, np.where(early, before[1], after[1])

    def _refer(self, t_s: float, angles: Sequence[float]) -> None:
        self._zero = (float(t_s), *map(float, angles))
        self._scored = bool(t_s >= self._zero_s)

    def _since(
        self,
        t_s: Floats,
        angles: Sequence[Floats],
        deviation: Floats,
        stiffness_xy: Floats,
        damping: tuple[Floats, Floats, Floats],
    ) -> tuple[list[Floats], Floats]:
        assert self._zero is not None
        start_s, *zeros = self._zero
        counted = [angle - zero for angle, zero in zip(angles, zeros, strict=True)]
        course = self._sources.course(t_s - start_s, counted[0], counted[1], stiffness_xy, damping)
        return counted, np.sqrt(sum(self._sources.variances(deviation, course).values()))
