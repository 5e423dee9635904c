"""How far the reported angle moves with each coefficient of the catalogue."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from estimator.core.following import Portion, Signatures, scan_block
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.side_by_side import stop_if_abandoned, together
from estimator.trace.observed import run
from estimator.trace.problem import Effects, Problem

INSTANTS = 512
"""Of a stretch, at which the angle's sensitivity is kept: it is drawn and bounded by so many points."""


@dataclass(frozen=True)
class Turning:
    """Sensitivity (m, k) of the angle, rad per SI unit, at `time` (m,) s; columns: those of each effect.

    shift, deviation (m,) rad: how far effects that were found there, and are not carried, turned the angle.
    """

    columns: dict[str, slice]
    time: Array
    sensitivity: Array
    shift: Array
    deviation: Array

    def of(self, name: str) -> Array:
        """Columns of an effect (m, its coefficients)."""
        return self.sensitivity[:, self.columns[name]]

    def course(self, names: Sequence[str], values: Array, covariance: Array) -> tuple[Array, Array]:
        """How far (m,) these effects turn the angle, and its standard deviation, with their coefficients (k,) together
        and the covariance (k, k) of those, SI.
        """
        moves = np.hstack([self.of(name) for name in names])
        spread = np.einsum("mi,ij,mj->m", moves, covariance, moves)
        return moves @ values, np.sqrt(np.maximum(spread, 0.0))

    def with_shift(self, shift: Array, deviation: Array) -> "Turning":
        """The same with something found there that turned the angle by so much (m,), rad."""
        return replace(self, shift=self.shift + shift, deviation=np.hypot(self.deviation, deviation))


def instants(samples: int) -> NDArray[np.int64]:
    """Samples (m,) after which a sensitivity is kept, evenly over so many of them."""
    count = min(INSTANTS, samples)
    return np.ceil(np.arange(1, count + 1) * samples / count).astype(np.int64) - 1


def following(problem: Problem, watched: int = 0) -> Observer:
    """The observer of a problem.  That of the classic loops knows what damps the axes differently, and follows the mean
    alone: the amplitude's loop sees to that.
    """
    observer = Observer(problem.device, problem.settings, problem.controller, watched=watched)
    if problem.settings.by_loops:
        observer.hold(["dxx", "dyy", "dxy"])
        mean = sum(problem.device.damping[:2]) / 2.0
        observer.assume(["dxx", "dyy"], np.full((2, 2), (problem.settings.spread.damping * mean) ** 2))
    return observer


def moved(problem: Problem, effects: Effects) -> Array:
    """How far (instants, 1) the angle that the observer of `problem` reports moves, rad, with these effects beside its
    own, coefficients and parameters SI, as large as they are.
    """

    def angle(beside: Effects) -> Array:
        including = problem.carrying({**problem.effects, **beside})
        observer = following(including)
        observer.hold([c.name for _, effect in observer.effects if effect.name in beside for c in effect.coefficients])
        return run(observer, problem.record).angle[instants(len(problem.record)), None]

    without, included = together(lambda: angle({}), lambda: angle(effects))
    return included - without


def followed(problem: Problem, tested: Effects) -> tuple[dict[str, slice], Array]:
    """Columns of each tested effect, and how far (instants, k) the angle that the observer of `problem` reports would
    have moved by each of the instants of its record, were a coefficient included, rad per SI unit.

    Raises ModelError as `Observer` does.
    """
    record, settings = problem.record, problem.settings
    including = replace(settings, effects={**settings.effects, **tested})
    observer = following(problem.under(including), len(tested))
    columns: dict[str, slice] = {}
    k = 0
    for _, effect in observer.effects[observer.carried :]:
        columns[effect.name] = slice(k, k := k + len(effect.coefficients))
    z, u, h, warmth = observer.scaled(record.sense, record.drive, record.step, record.channels.get("temperature"))
    observer.allow_steps(float(np.max(h, initial=observer.h)), u.shape[2] - 1)
    delta, turned = np.zeros((observer.states + len(observer.active), k)), np.zeros(k)
    kept, gaps = (instants(len(record)) + 1).tolist(), record.gaps
    added = {} if gaps is None else dict(zip((gaps.last + 1).tolist(), gaps.spread, strict=True))
    course = np.zeros((len(kept), k))
    for begin, end in pairwise([0, *sorted({*kept, *added})]):
        stop_if_abandoned()
        rows, read = slice(begin, end), slice(np.searchsorted(kept, end), np.searchsorted(kept, end, side="right"))
        scan_block(observer, Portion(z[rows], u[rows], h[rows], warmth[rows]), Signatures(delta, turned=turned))
        course[read] = turned / problem.device.angular_gain
        if end in added:
            observer.unsettle(added[end])
    return columns, course / observer.factors[len(observer.names) - k :]
