"""The constants of an oscillator from pieces of records: Gauss and Newton on the likelihood of the innovations.

Each piece begins with a motion of its own, which enters linearly and is eliminated (variable projection).  Force noise
is one number more, found by the likelihood itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.identify.model import AT_REST, NAMES, Array, Piece, Predictor, Stage, discrete, stages

PASSES = 30
SETTLED, ROUGH = 0.01, 0.5  # of a standard deviation: a step that short is none
_STEP = 1e-3  # of a scale, in the first pass, over the samples: no cycle is lost
_PART = 0.03  # of a standard deviation, then: the likelihood is a parabola there
_FORCES = (-4.0, 2.0)  # decades about the force noise that moves a free mass as far as the sense noise, in a piece
_FAR = 10.0  # of it: nothing lies beyond
_RISE = 1.0  # of the log-likelihood, that a force noise has to bring


@dataclass(frozen=True)
class Fitted:
    """θ (14,) and its covariance, both per sample; noise (2,) [V] of the sense voltages; force: variance of the force
    noise over a sample's time, (m/s²)²; samples; misfit: −log-likelihood, up to a constant.
    """

    theta: Array
    covariance: Array
    noise: Array
    force: float
    samples: int
    misfit: float
    converged: bool

    def of(self, name: str) -> float:
        """An entry of θ."""
        return float(self.theta[NAMES.index(name)])

    def deviation(self, name: str) -> float:
        """Its standard deviation."""
        at = NAMES.index(name)
        return float(np.sqrt(self.covariance[at, at]))


def scales(theta: Array) -> Array:
    """(14,) in which θ moves: what is small beside them changes nothing that can be seen."""
    k, g = 0.5 * (theta[0] + theta[1]), np.abs(theta[7:9])
    d = max(0.5 * (theta[3] + theta[4]), 1e-6 * np.sqrt(k))
    return np.array([k, k, k, d, d, d, d, *g, 1.0, 1.0, 1.0, 1.0, 1.0])


class Begun(NamedTuple):
    """By piece: innovations (n, 2) in deviations of the sense noise as it was taken, whitened; the first motion (4,)
    that makes them least; what its entries make of them (4, 2 n).  noise (2,) [V] of all of them; misfit.
    """

    left: list[Array]
    motions: list[Array]
    bases: list[Array]
    noise: Array
    misfit: float


def innovations(predictor: Predictor, parts: Sequence[Piece], noise: Array) -> Begun:
    """Of each piece with its best first motion; noise (2,) [V]: by which the axes are weighed for that."""
    left, motions, bases, logs = [], [], [], 0.0
    for piece in parts:
        wider = predictor.wider(len(piece.sense)) * noise
        basis = (predictor.begun(len(piece.sense)) / wider).reshape(4, -1)
        error = (piece.sense - predictor.predicted(piece, np.zeros(4))) / wider
        size = np.sqrt(np.sum(basis * basis, axis=1))
        scaled = basis / size[:, None]
        motion = np.linalg.solve(scaled @ scaled.T, scaled @ error.ravel()) / size
        left.append(error - (motion @ basis).reshape(-1, 2))
        motions.append(motion)
        bases.append(basis)
        logs += float(np.sum(np.log(wider)))
    squares = sum(np.sum(rows * rows, axis=0) for rows in left)
    count = sum(len(rows) for rows in left)
    spread = np.sqrt(squares / count)
    return Begun(left, motions, bases, spread * noise, logs + count * float(np.sum(np.log(spread))))


def fit(
    parts: Sequence[Piece],
    theta: Array,
    *,
    force: float = 0.0,
    noise: Array | None = None,
    settled: float = SETTLED,
    only: tuple[int, ...] = (),
) -> Fitted:
    """The maximum next to `theta` at this force noise, to within so much of a standard deviation (Levenberg and
    Marquardt); noise (2,) [V]: of the sense voltages, which a force noise needs to be told; only: entries that are
    fitted, the others held, all without any.
    """
    longest = max(len(p.sense) for p in parts)
    course = AT_REST
    if force > 0.0 and noise is not None:
        course = stages(discrete(theta), force, noise, longest)
    noise = innovations(Predictor(theta, course), parts, np.ones(2)).noise if noise is None else noise
    begun = innovations(Predictor(theta, course), parts, noise)
    damping, converged = 0.0, False
    free = np.array(only or range(len(theta)))
    steps = _STEP * scales(theta) / longest
    covariance = np.zeros((len(theta), len(theta)))
    for _ in range(PASSES):
        information, score = _equations(Predictor(theta, course), parts, begun, noise, steps, free)
        unit = 1.0 / np.sqrt(np.diag(information))
        scaled = information * np.outer(unit, unit)
        covariance[np.ix_(free, free)] = np.linalg.pinv(scaled, hermitian=True) * np.outer(unit, unit)
        steps[free] = _PART * np.sqrt(np.diag(covariance))[free]
        step = np.zeros(len(theta))
        step[free] = np.linalg.solve(scaled + (damping + 1e-12) * np.eye(len(free)), score * unit) * unit
        if float(score @ step[free]) < settled**2 * len(free):
            converged = True
            break
        moved = _tried(theta + step, course, parts, noise)
        if moved is None or moved.misfit >= begun.misfit:
            damping = max(10.0 * damping, 1e-4)
            if damping > 1e6:
                break
            continue
        gained = begun.misfit - moved.misfit
        theta, begun = theta + step, moved
        if damping == 0.0 and gained < 0.5 * settled**2 * len(theta):
            converged = True
            break
        damping = damping / 10.0 if damping > 1e-6 else 0.0
    samples = sum(len(p.sense) for p in parts)
    return Fitted(theta, covariance, begun.noise, force, samples, begun.misfit, converged)


def _tried(theta: Array, course: tuple[Stage, ...], parts: Sequence[Piece], noise: Array) -> Begun | None:
    try:
        with np.errstate(all="ignore"):
            begun = innovations(Predictor(theta, course), parts, noise)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return begun if np.isfinite(begun.misfit) else None


def _equations(
    at: Predictor, parts: Sequence[Piece], begun: Begun, noise: Array, steps: Array, free: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Information (k, k) and score (k,) of the entries `free`, with the first motion of each piece projected out."""
    count, shifts = len(free), np.diag(steps)[free]
    moved = [Predictor(at.theta + shift, at.course) for shift in shifts]
    information, score = np.zeros((count, count)), np.zeros(count)
    spread = begun.noise / noise
    for piece, error, motion, basis in zip(parts, begun.left, begun.motions, begun.bases, strict=True):
        wider = at.wider(len(error)) * begun.noise
        here = at.predicted(piece, motion)
        rows = np.empty((count, error.size))
        for k, other in enumerate(moved):
            rows[k] = ((other.predicted(piece, motion) - here) / (steps[free[k]] * wider)).ravel()
        first = (basis.reshape(4, -1, 2) / spread).reshape(4, -1)
        first = first / np.sqrt(np.sum(first * first, axis=1))[:, None]
        rows -= np.linalg.solve(first @ first.T, first @ rows.T).T @ first
        information += rows @ rows.T
        score += rows @ (error / spread).ravel()
    return information, score


def with_force_noise(parts: Sequence[Piece], found: Fitted, least: float = 0.0) -> Fitted:
    """The same with the force noise that makes the record most probable, `least` or more of it."""
    gain, omega = float(np.mean(np.abs(found.theta[7:9]))), float(np.sqrt(np.mean(found.theta[:2])))
    unit = (float(np.mean(found.noise)) * omega / gain) ** 2 / max(len(p.sense) for p in parts)
    tried: dict[float, Fitted] = {least: fit(parts, found.theta, force=least, noise=found.noise, settled=0.2)}

    def best() -> Fitted:
        return min(tried.values(), key=lambda one: one.misfit)

    for decade in np.arange(*_FORCES):
        if (force := unit * 10.0**decade) > least:
            near = tried[max(tried)]
            tried[force] = fit(parts, near.theta, force=force, noise=found.noise, settled=0.3)
            if tried[force].misfit > best().misfit + _FAR:
                break
    if best().misfit > tried[least].misfit - _RISE:
        return fit(parts, tried[least].theta, force=least, noise=found.noise)
    for step in (10.0**0.5, 10.0**0.25):
        near = best()
        for force in (near.force / step, near.force * step):
            if force > least:
                tried[force] = fit(parts, near.theta, force=force, noise=found.noise, settled=0.3)
    return fit(parts, best().theta, force=best().force, noise=found.noise)


def grown(parts: Sequence[Piece], theta: Array, thermal: float = 0.0, first: int = 1500) -> Fitted:
    """The maximum from start values: in short parts, each with a first motion of its own, and then in longer ones, so
    that a wrong frequency never loses count of the cycles (multiple shooting).

    thermal: force noise per damping [(m/s²)² · sample], which is there whatever else is: 2 kB T fs² / m; 0: not known.
    """
    longest = max(len(piece.sense) for piece in parts)
    length = first
    while length < longest:
        theta = fit([part for piece in parts for part in piece.parted(length)], theta, settled=ROUGH).theta
        length *= 6
    found = fit(parts, theta)
    return with_force_noise(parts, found, thermal * max(0.5 * (found.of("dxx") + found.of("dyy")), 0.0))
