"""What stays uncertain of the angle when the effects that were found are carried: what could not be compensated.

A coefficient is known within its interval only, and of two effects that a record cannot tell apart either may be the
one.  The bench's own observer reads the whole record once for each such possibility.  Angles are those that a run
reports: zero where it begins to be scored.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from estimator.chance import TWO_SIDED
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.side_by_side import side_by_side, together
from estimator.trace.examination import Examination, Figures
from estimator.trace.observed import run
from estimator.trace.problem import Effects, Problem
from estimator.trace.start import settled_from


@dataclass(frozen=True)
class AngleReader:
    """The bench's observer over one record, with any effects."""

    problem: Problem
    _known: dict[str, Array] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, problem: Problem, seen: Iterable[Figures]) -> "AngleReader":
        """A reader which does not read again what examinations of the record read already."""
        reader = cls(problem)
        bare = problem.carrying({})
        for one in seen:
            if isinstance(one, Examination) and one.problem.record is problem.record:
                other = one.problem.carrying({})
                if (other.settings, other.controller) == (bare.settings, bare.controller):
                    reader._keep(one.problem.effects, one.estimates.angle)
        return reader

    def _keep(self, effects: Effects, read: Array) -> None:
        start = self._scored_from(len(read))
        self._known[repr(effects)] = np.asarray(read[start:] - read[start])

    def _scored_from(self, samples: int) -> int:
        """First of so many samples that is scored; that where the observer has settled, if the record ends before."""
        problem = self.problem
        if problem.scored_from is not None:
            steps = problem.record.step[:samples]
            begun = int(np.searchsorted(np.cumsum(steps) - steps[0], problem.scored_from - 1e-3 * steps[0]))
            if begun < samples - 1:
                return begun
        return settled_from(problem.settings, problem.device, samples)

    def angle(self, effects: Effects) -> Array:
        """Angle [rad] of each scored sample, zero at the first."""
        problem = self.problem.carrying(effects)
        if repr(problem.effects) not in self._known:
            observer = Observer(problem.device, problem.settings, problem.controller)
            observer.hold_coefficients()
            self._keep(problem.effects, run(observer, problem.record).angle)
        return self._known[repr(problem.effects)]

    def moved(self, effects: Effects, others: Effects) -> float:
        """Largest change of the angle, rad, when the others are carried in place of these."""
        one, other = together(lambda: self.angle(effects), lambda: self.angle(others))
        return float(np.max(np.abs(one - other)))

    def bound(self, effects: Effects, name: str, covariance: Array) -> float:
        """By how much in rad the angle may be wrong because the coefficients of `name` are known within 95 % only.

        Each principal axis of their covariance by itself; the moves added as squares.
        """
        scale = np.sqrt(np.diagonal(covariance))
        scale = np.where(scale > 0.0, scale, 1.0)  # one that is known exactly moves nothing
        sizes, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
        shifts = TWO_SIDED * np.sqrt(np.maximum(sizes, 0.0))[:, None] * axes.T * scale
        asked = [effects, *(_shifted(effects, name, shift) for shift in shifts)]
        usual, *moved = side_by_side([partial(self.angle, one) for one in asked])
        return float(np.sqrt(sum(float(np.max(np.abs(angle - usual))) ** 2 for angle in moved)))


def _shifted(effects: Effects, name: str, by: Array) -> dict[str, dict[str, float]]:
    """The effects with the coefficients of `name`, in their order, shifted."""
    moved = {key: dict(given) for key, given in effects.items()}
    for symbol, shift in zip(moved[name], by, strict=False):  # parameters follow the coefficients, and stay
        moved[name][symbol] += float(shift)
    return moved
