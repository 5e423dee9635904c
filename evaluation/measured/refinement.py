"""Parameters by simulation error: the start, constants and coefficients whose free run lies closest to the record.

A filter's last estimate is not the best one.  Least squares over the whole record with the exact derivatives of the
free run; the intervals allow for a residual that is not white (Ljung, System Identification, 1999, ch. 9).

What is declared of a constant counts as one more observation of it, as in the observer.  Beside a residual that is
larger than the noise, or correlated, it counts for as much more: such samples say less than their number and noise
claim.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from estimator.correlation import effective_samples
from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.side_by_side import stop_if_abandoned
from evaluation.measured.free_stretches import FreeRuns

_T95 = 1.959963984540054
_FARTHEST = 1e12  # × the noise: a run that is so far off has left the record, and its squares all numbers
_BLIND = 1e-9  # of the largest singular value: below it the record says nothing of a direction


@dataclass(frozen=True)
class Declared:
    """What is known of a constant beforehand, SI: its value and the standard deviation of that."""

    value: float
    deviation: float


@dataclass(frozen=True)
class Refined:
    """What a refinement found, SI.

    state (states + constants,) in the order of `names`: state at the first sample, constants, coefficients; deviation
    of each (0 where it was held); free: the names that were fitted; residual (n, axes) V of the free run over the
    whole record, rmse (axes,) V of it over the fitted rows; known: what was declared, by name; information (free,
    free): what the record by itself says of them, 1/SI².
    """

    names: tuple[str, ...]
    free: tuple[str, ...]
    state: Array
    deviation: Array
    residual: Array
    rmse: Array
    known: Mapping[str, Declared] = field(default_factory=dict)
    information: Array = field(default_factory=lambda: np.zeros((0, 0)))

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
    known: Mapping[str, Declared] | None = None,
    stretches: Sequence[slice] = (),
) -> Refined:
    """Fit a free run to a record: sense (n, axes) V (NaN where lost), drive and step as for `simulate`.

    start (states + constants,) SI, by default what the observer holds; free: the names that may change, by default all
    that the observer estimates; rows: the samples whose residual counts, by default all; runs: free runs at most;
    known: what is declared, of any of the free ones; stretches: parts of the record that gaps keep apart, each of which
    has a start of its own (`evaluation.measured.free_stretches`).

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
    runs_of = FreeRuns(observer, sense, drive, step, stretches)
    chosen &= runs_of.told
    if int(np.sum(chosen)) < len(index):
        raise ModelError(f"{int(np.sum(chosen))} samples for {len(index)} unknowns; give a longer record")
    noise = np.asarray(observer.device.noise)
    weight = np.broadcast_to(1.0 / noise, sense.shape)[chosen]
    scale = scales(observer)[index]
    least = least_values(observer)[index] / scale
    cache: dict[bytes, tuple[Array, Array]] = {}

    def run(scaled: Array) -> tuple[Array, Array]:
        stop_if_abandoned()
        key = scaled.tobytes()
        if key not in cache:
            cache.clear()
            trial = state.copy()
            trial[index] = scaled * scale
            try:
                simulation = runs_of.simulate(trial, sensitive=True)
                if not float(np.max(np.abs(simulation.sensed[chosen] * weight), initial=0.0)) < _FARTHEST:
                    raise ModelError("the free run leaves all bounds; start nearer, or correct the bench file")
            except ModelError:
                if scaled is origin:
                    raise
                # Beyond all bounds: the search is told to come back.
                return np.full(len(weight), _FARTHEST), np.zeros((len(weight), len(index)))
            residual = (simulation.sensed - sense)[chosen] * weight
            jacobian = simulation.sensitivity[chosen][:, index] * scale * weight[:, None]
            cache[key] = residual, jacobian
        return cache[key]

    origin = state[index] / scale
    run(origin)
    given = {name: one for name, one in (known or {}).items() if name in wanted and one.deviation > 0.0}
    at = np.array([wanted.index(name) for name in given], dtype=np.int64)
    first = np.array([one.value for one in given.values()]) / scale[at]
    sure = np.array([one.deviation for one in given.values()]) / np.abs(scale[at])

    def solved(begin: Array, worth: float) -> Array:
        return least_squares_beside(run, begin, at, first, sure / worth, tolerance=1e-10, runs=runs, least=least)

    solution, worth = solved(origin, 1.0), 1.0
    if given and (worth := worth_of(run(solution)[0])) > 1.0:
        solution = solved(solution, worth)
    state[index] = solution * scale
    deviation = np.zeros(len(names))
    weighted, jacobian = run(solution)
    told = np.zeros(len(index))
    told[at] = (worth / sure) ** 2
    deviation[index] = np.sqrt(np.diagonal(covariance_of(jacobian, weighted, told, worth))) * np.abs(scale)
    residual = sense - runs_of.simulate(state).sensed
    rmse = np.array([np.sqrt(np.mean(r[c] ** 2)) for r, c in zip(residual.T, chosen.T, strict=True)])
    information = _information(jacobian, weighted) / np.outer(scale, scale)
    return Refined(names, wanted, state, deviation, residual, rmse, given, information)


def least_squares_beside(
    rows: Callable[[Array], tuple[Array, Array]],
    begin: Array,
    places: NDArray[np.int64],
    known: Array,
    sure: Array,
    *,
    tolerance: float,
    runs: int,
    least: Array | float = -np.inf,
) -> Array:
    """Unknowns (k,), none below `least`, that leave least of `rows`, residuals (n,) and their Jacobian (n, k), and
    of what is known beforehand: of the unknowns at `places`, that they are `known` within standard deviations `sure`.
    """
    told = np.zeros((len(places), len(begin)))
    told[np.arange(len(places)), places] = 1.0 / sure
    return np.asarray(
        least_squares(
            lambda unknown: np.concatenate([rows(unknown)[0], (unknown[places] - known) / sure]),
            begin,
            jac=lambda unknown: np.concatenate([rows(unknown)[1], told]),
            x_scale="jac",
            ftol=tolerance,
            xtol=tolerance,
            gtol=1e-2 * tolerance,
            max_nfev=runs,
            bounds=(least, np.inf),
        ).x
    )


def worth_of(weighted: Array) -> float:
    """By how much a residual over the declared noise is larger than white noise of that size, correlation included."""
    return float(np.sqrt(np.mean(weighted**2) * len(weighted) / effective_samples(weighted)))


def scales(observer: Observer) -> Array:
    """SI size of a likely change of each entry of the state vector: the spread it enters the observer with."""
    factors = np.array(np.abs(observer.factors))
    spread = observer.initial_deviations
    factors[observer.estimated_index] *= np.where(spread > 0.0, spread, 1.0)
    return np.asarray(factors)


def least_values(observer: Observer) -> Array:
    """SI values (states + constants,) below which no fit goes, −∞ where it may: a length that must not vanish."""
    least = np.full(len(observer.names), -np.inf)
    for _, effect in observer.effects:
        for coefficient in effect.coefficients:
            place = observer.names.index(coefficient.name)
            least[place] = coefficient.least * observer.factors[place]
    return least


def covariance_of(jacobian: Array, residual: Array, told: Array, worth: float) -> Array:
    """Covariance of least squares whose residual is coloured: (JᵀJ + P)⁻¹ (Jᵀ Σ J + w² P) (JᵀJ + P)⁻¹, Σ from its own
    spectrum, P the information of what is declared, whose weight w was.
    """
    _, sizes, directions = np.linalg.svd(np.concatenate([jacobian, np.diag(np.sqrt(told))]), full_matrices=False)
    seen = sizes > _BLIND * sizes[0]
    inverse = (directions[seen].T / sizes[seen] ** 2) @ directions[seen]
    middle = _middle(jacobian, residual) + worth**2 * np.diag(told)
    return np.asarray(inverse @ middle @ inverse)


def _information(jacobian: Array, residual: Array) -> Array:
    """What the residual's rows say by themselves: JᵀJ (Jᵀ Σ J)⁻¹ JᵀJ, nothing in directions that they do not see."""
    _, sizes, directions = np.linalg.svd(jacobian, full_matrices=False)
    seen = sizes > _BLIND * max(float(sizes[0]), np.finfo(float).tiny)
    rows = (directions[seen].T * sizes[seen] ** 2).T
    middle = directions[seen] @ _middle(jacobian, residual) @ directions[seen].T
    return np.asarray(rows.T @ np.linalg.pinv(middle, hermitian=True) @ rows)


def _middle(jacobian: Array, residual: Array) -> Array:
    """Jᵀ Σ J of a residual (n,) with the covariance Σ that its smoothed spectrum says."""
    n, unknowns = jacobian.shape
    power = np.abs(np.fft.rfft(residual)) ** 2 / max(n - unknowns, 1)
    width = max(int(len(power) ** 0.5), 3)
    smooth = np.convolve(np.pad(power, width, mode="reflect"), np.ones(width) / width, mode="same")[width:-width]
    spectrum = np.fft.rfft(jacobian, axis=0)
    twice = np.full(len(smooth), 2.0)
    twice[0] = 1.0
    if n % 2 == 0:
        twice[-1] = 1.0
    return np.asarray(np.real((spectrum.conj().T * (smooth * twice)) @ spectrum) / n)
