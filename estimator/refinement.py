"""Parameters by simulation error: the start, constants and coefficients whose free run lies closest to the record.

A filter's last estimate is not the best one.  Least squares over the whole record with the exact derivatives of the
free run; the intervals allow for a residual that is not white (Ljung, System Identification, 1999, ch. 9).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.simulation import simulate

_T95 = 1.959963984540054
_BLIND = 1e-9  # of the largest singular value: below it the record says nothing of a direction


@dataclass(frozen=True)
class Refined:
    """What a refinement found, SI.

    state (states + constants,) in the order of `names`: state at the first sample, constants, coefficients; deviation
    of each (0 where it was held); free: the names that were fitted; residual (n, axes) V of the free run over the
    whole record, rmse (axes,) V of it over the fitted rows.
    """

    names: tuple[str, ...]
    free: tuple[str, ...]
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
        half = _T95 * float(self.deviation[i])
        return float(self.state[i]) - half, float(self.state[i]) + half


def refine(
    observer: Observer,
    sense: Array,
    drive: Array,
    *,
    start: Array | None = None,
    free: Sequence[str] | None = None,
    step: Array | None = None,
    rows: slice | NDArray[np.bool_] | None = None,
    runs: int = 60,
) -> Refined:
    """Fit a free run to a record: sense (n, axes) V (NaN where lost), drive and step as for `simulate`.

    start (states + constants,) SI, by default what the observer holds; free: the names that may change, by default all
    that the observer estimates; rows: the samples whose residual counts, by default all; runs: free runs at most.

    Raises ModelError for unknown names, for rows without samples, and for a start from which the run leaves all bounds.
    """
    names = observer.names
    wanted = observer.estimated if free is None else tuple(free)
    if strange := set(wanted) - set(names):
        raise ModelError(f"nothing named {', '.join(sorted(strange))}; known: {', '.join(names)}")
    index = np.array([names.index(name) for name in wanted], dtype=np.int64)
    state = np.array(observer.state if start is None else start, dtype=float)
    chosen = np.zeros(sense.shape, dtype=bool)
    chosen[slice(None) if rows is None else rows] = True
    chosen &= np.isfinite(sense)
    if int(np.sum(chosen)) < len(index):
        raise ModelError(f"{int(np.sum(chosen))} samples for {len(index)} unknowns; give a longer record")
    noise = np.asarray(observer.device.noise)
    weight = np.broadcast_to(1.0 / noise, sense.shape)[chosen]
    scale = _scales(observer)[index]
    cache: dict[bytes, tuple[Array, Array]] = {}

    def run(scaled: Array) -> tuple[Array, Array]:
        key = scaled.tobytes()
        if key not in cache:
            cache.clear()
            trial = state.copy()
            trial[index] = scaled * scale
            try:
                simulation = simulate(observer, trial, drive, step=step, sensitive=True)
            except ModelError:
                if scaled is origin:
                    raise
                # Beyond all bounds: the search is told to come back.
                return np.full(len(weight), 1e6), np.zeros((len(weight), len(index)))
            residual = (simulation.sensed - sense)[chosen] * weight
            jacobian = simulation.sensitivity[chosen][:, index] * scale * weight[:, None]
            cache[key] = residual, jacobian
        return cache[key]

    origin = state[index] / scale
    run(origin)

    def residual_of(scaled: Array) -> Array:
        return run(scaled)[0]

    def jacobian_of(scaled: Array) -> Array:
        return run(scaled)[1]

    solution = least_squares(
        residual_of,
        origin,
        jac=jacobian_of,
        x_scale="jac",
        method="trf",
        ftol=1e-10,
        xtol=1e-10,
        gtol=1e-12,
        max_nfev=runs,
    )
    state[index] = solution.x * scale
    deviation = np.zeros(len(names))
    weighted, jacobian = run(solution.x)
    deviation[index] = np.sqrt(np.diagonal(_covariance(jacobian, weighted))) * np.abs(scale)
    residual = sense - simulate(observer, state, drive, step=step).sensed
    rmse = np.array([np.sqrt(np.mean(r[c] ** 2)) for r, c in zip(residual.T, chosen.T, strict=True)])
    return Refined(names, wanted, state, deviation, residual, rmse)


def _scales(observer: Observer) -> Array:
    """SI size of a likely change of each entry of the state vector: the spread it enters the observer with."""
    factors = np.array(np.abs(observer.factors))
    spread = np.sqrt(np.concatenate([observer.motion_spread, observer.spread]))
    factors[observer.estimated_index] *= np.where(spread > 0.0, spread, 1.0)
    return np.asarray(factors)


def _covariance(jacobian: Array, residual: Array) -> Array:
    """Covariance of least squares whose residual is coloured: (JᵀJ)⁻¹ Jᵀ Σ J (JᵀJ)⁻¹, Σ from its own spectrum."""
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
