"""Parameters by simulation error: the start, constants and coefficients whose free run lies closest to the record.

A filter's last estimate is not the best one.  Least squares over the whole record with the exact derivatives of the
free run; the intervals allow for a residual that is not white (Ljung, System Identification, 1999, ch. 9).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from estimator.chance import TWO_SIDED
from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.side_by_side import stop_if_abandoned
from estimator.simulation import simulate

_FARTHEST = 1e12  # × the noise: a run that is so far off has left the record, and its squares all numbers
_BLIND = 1e-9  # of the largest singular value: below it the record says nothing of a direction
_TOLERANCE = 1e-10


@dataclass(frozen=True)
class Refined:
    """What a refinement found, SI.

    state (states + constants,) in the order of `names`: state at the first sample, constants, coefficients; deviation
    of each (0 where it was held); residual (n, axes) V of the free run over the whole record, rmse (axes,) V of it.
    """

    names: tuple[str, ...]
    state: Array
    deviation: Array
    residual: Array
    rmse: Array

    def value(self, name: str) -> float:
        """Value by name."""
        return float(self.state[self.names.index(name)])

    def interval(self, name: str) -> tuple[float, float]:
        """95 % interval by name."""
        i = self.names.index(name)
        half = TWO_SIDED * float(self.deviation[i])
        return float(self.state[i]) - half, float(self.state[i]) + half


def refine(
    observer: Observer,
    sense: Array,
    drive: Array,
    *,
    start: Array | None = None,
    free: Sequence[str] | None = None,
    step: Array | None = None,
    runs: int = 60,
) -> Refined:
    """Fit a free run to a record: sense (n, axes) V, NaN where lost, drive and step as for `simulate`.

    start (states + constants,) SI, by default what the observer holds; free: the names that may change, by default all
    that the observer estimates; runs: free runs at most.

    Raises ModelError for unknown names, for too few samples, and for a start from which the run leaves all bounds.
    """
    names = observer.names
    wanted = observer.estimated if free is None else tuple(free)
    if strange := set(wanted) - set(names):
        raise ModelError(f"nothing named {', '.join(sorted(strange))}; known: {', '.join(names)}")
    index = np.array([names.index(name) for name in wanted], dtype=np.int64)
    state = np.array(observer.state if start is None else start, dtype=float)
    chosen = np.isfinite(sense)
    if int(np.sum(chosen)) < len(index):
        raise ModelError(f"{int(np.sum(chosen))} samples for {len(index)} unknowns; give a longer record")
    weight = np.broadcast_to(1.0 / np.asarray(observer.device.noise), sense.shape)[chosen]
    scale = _scales(observer)[index]
    cache: dict[bytes, tuple[Array, Array]] = {}

    def run(scaled: Array) -> tuple[Array, Array]:
        stop_if_abandoned()
        key = scaled.tobytes()
        if key not in cache:
            cache.clear()
            trial = state.copy()
            trial[index] = scaled * scale
            try:
                simulation = simulate(observer, trial, drive, step=step, sensitive=True)
                if not float(np.max(np.abs(simulation.sensed[chosen] * weight), initial=0.0)) < _FARTHEST:
                    raise ModelError("the free run leaves all bounds; start nearer, or correct the bench file")
            except ModelError:
                if scaled is origin:
                    raise
                # Beyond all bounds: the search is told to come back.
                return np.full(len(weight), _FARTHEST), np.zeros((len(weight), len(index)))
            residual = (simulation.sensed - sense)[chosen] * weight
            cache[key] = residual, simulation.sensitivity[chosen][:, index] * scale * weight[:, None]
        return cache[key]

    origin = state[index] / scale
    run(origin)
    least = _least(observer)[index] / scale
    solution = least_squares(
        lambda scaled: run(scaled)[0], origin, jac=lambda scaled: run(scaled)[1], x_scale="jac", ftol=_TOLERANCE,
        xtol=_TOLERANCE, gtol=1e-2 * _TOLERANCE, max_nfev=runs, bounds=(least, np.inf),
    ).x  # fmt: skip
    state[index] = solution * scale
    deviation = np.zeros(len(names))
    weighted, jacobian = run(solution)
    deviation[index] = np.sqrt(np.diagonal(_covariance(jacobian, weighted))) * np.abs(scale)
    residual = sense - simulate(observer, state, drive, step=step).sensed
    rmse = np.array([np.sqrt(np.mean(r[c] ** 2)) for r, c in zip(residual.T, chosen.T, strict=True)])
    return Refined(names, state, deviation, residual, rmse)


def _scales(observer: Observer) -> Array:
    """SI size of a likely change of each entry of the state vector: the spread it enters the observer with."""
    factors = np.array(np.abs(observer.factors))
    spread = observer.initial_deviations
    factors[observer.estimated_index] *= np.where(spread > 0.0, spread, 1.0)
    return np.asarray(factors)


def _least(observer: Observer) -> Array:
    """SI values (states + constants,) below which no fit goes, −∞ where it may: a length that must not vanish."""
    least = np.full(len(observer.names), -np.inf)
    for _, effect in observer.effects:
        for coefficient in effect.coefficients:
            place = observer.names.index(coefficient.name)
            least[place] = coefficient.least * observer.factors[place]
    return least


def _covariance(jacobian: Array, residual: Array) -> Array:
    """(JᵀJ)⁻¹ Jᵀ Σ J (JᵀJ)⁻¹ of least squares whose residual (n,) is coloured, Σ from its own smoothed spectrum."""
    _, sizes, directions = np.linalg.svd(jacobian, full_matrices=False)
    seen = sizes > _BLIND * sizes[0]
    inverse = (directions[seen].T / sizes[seen] ** 2) @ directions[seen]
    n, unknowns = jacobian.shape
    power = np.abs(np.fft.rfft(residual)) ** 2 / max(n - unknowns, 1)
    width = max(int(len(power) ** 0.5), 3)
    smooth = np.convolve(np.pad(power, width, mode="reflect"), np.ones(width) / width, mode="same")[width:-width]
    spectrum = np.fft.rfft(jacobian, axis=0)
    twice = np.full(len(smooth), 2.0)
    twice[0] = 1.0
    if n % 2 == 0:
        twice[-1] = 1.0
    middle = np.real((spectrum.conj().T * (smooth * twice)) @ spectrum) / n
    return np.asarray(inverse @ middle @ inverse)
