"""A free run over a record with gaps: behind each it begins anew, where the record itself tells the motion.

What drove the mass over a gap is not known, so that the motion behind it does not follow from what was before.  It is
two more unknowns for each axis, found by least squares over the stretch; the derivatives by all other unknowns are
those beside it (variable projection: Golub & Pereyra 1973).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.simulation import Simulation, simulate

_ROUNDS = 8  # of Gauss and Newton; a linear model takes one
_SETTLED = 1e-9  # of the scale of a motion
_BLIND = 1e-9
_FARTHEST = 1e12  # × the noise


class FreeRuns:
    """Free runs of one record: sense (n, axes) V, NaN where lost; drive and step as for `simulate`; stretches: parts of
    the record, one after another, that gaps keep apart, by default one.

    Motions behind gaps are kept from one run to the next, as a start.
    """

    def __init__(
        self, observer: Observer, sense: Array, drive: Array, step: Array | None, stretches: Sequence[slice] = ()
    ) -> None:
        self._observer, self._sense, self._drive, self._step = observer, sense, drive, step
        self._first, *self._later = stretches or (slice(0, len(sense)),)
        self._motion = [np.zeros(observer.states) for _ in self._later]

    @property
    def told(self) -> NDArray[np.bool_]:
        """Whether each sample (n, axes) is there, and in a stretch that is long enough to tell its motion."""
        told = np.isfinite(self._sense)
        for stretch in self._later:
            if int(np.sum(told[stretch])) <= self._observer.states:
                told[stretch] = False
        return told

    def simulate(self, state: Array, *, sensitive: bool = False) -> Simulation:
        """As `estimator.simulation.simulate`, from `state` at the first sample; NaN over a stretch that does not tell
        its motion.

        Raises ModelError as that does.
        """
        if not self._later:
            return simulate(self._observer, state, self._drive, step=self._step, sensitive=sensitive)
        told = self.told
        parts = [self._simulated(state, self._first, sensitive)]
        for number, stretch in enumerate(self._later):
            parts.append(self._begun_anew(state, number, stretch, told[stretch], sensitive))
        return Simulation(
            np.concatenate([part.sensed for part in parts]), np.concatenate([part.sensitivity for part in parts])
        )

    def _simulated(self, state: Array, stretch: slice, sensitive: bool) -> Simulation:
        step = None if self._step is None else self._step[stretch]
        return simulate(self._observer, state, self._drive[stretch], step=step, sensitive=sensitive)

    def _begun_anew(
        self, state: Array, number: int, stretch: slice, told: NDArray[np.bool_], sensitive: bool
    ) -> Simulation:
        motion, rows = slice(0, self._observer.states), stretch.stop - stretch.start
        if not told.any():
            axes, unknowns = self._sense.shape[1], len(state)
            return Simulation(np.full((rows, axes), np.nan), np.zeros((rows if sensitive else 0, axes, unknowns)))
        start = np.array(state, dtype=float)
        start[motion] = self._motion[number]
        weight = np.broadcast_to(1.0 / np.asarray(self._observer.device.noise), told.shape)[told]
        scale = np.abs(self._observer.factors[motion])
        for _ in range(_ROUNDS):
            run = self._simulated(start, stretch, True)
            jacobian = run.sensitivity[told][:, motion] * scale * weight[:, None]
            residual = (self._sense[stretch] - run.sensed)[told] * weight
            if not float(np.max(np.abs(residual))) < _FARTHEST:
                raise ModelError("the free run behind a gap leaves all bounds; start nearer, or bound the coefficients")
            change = np.linalg.lstsq(jacobian, residual, rcond=_BLIND)[0]
            if float(np.max(np.abs(change))) < _SETTLED:
                break
            start[motion] += change * scale
        self._motion[number] = start[motion].copy()
        if not sensitive:
            return Simulation(run.sensed, np.zeros((0, *run.sensitivity.shape[1:])))
        own, every = run.sensitivity[..., motion], run.sensitivity
        answer = np.linalg.lstsq(jacobian, every[told] * weight[:, None], rcond=_BLIND)[0] * scale[:, None]
        beside = every - own @ answer
        beside[..., motion] = 0.0  # the start of the record does not reach here
        return Simulation(run.sensed, beside)
