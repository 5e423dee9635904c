"""The unknown force along a record: the motion with a latent force, forward and backward, its size by likelihood.

The model is that of `beside` with the latent force of `latent`; its step is the same all along the record, so that the
gain settles, and a million samples cost seconds.  Around a lost sample the settled gain is not the best one, and the
band is that of the rest of the record.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import schur, solve_discrete_are, solve_discrete_lyapunov
from scipy.signal import lfilter

from estimator.errors import ModelError
from estimator.missing_force.beside import Beside
from estimator.missing_force.latent import PARTS, Augmented, Latent, augmented
from estimator.scaling import Array
from estimator.trace.noise import level

_DECADES = (-14.0, 2.0)
"""Between which the variance of a part is looked for; at the least it is not there."""
_BEGIN, _CLOSE, _ROUNDS = 1e-6, 0.5, 3
"""Variance of each part at first, scaled; decades to which it is found; how often all are gone through."""
_CYCLES = (4.0, 16.0, 64.0)
_BEGINS = 40.0  # cycles that tell how a record begins
_WINDOWS, _WINDOW = 3, 2_000  # parts of a record, and samples of each, that tell a variance to a decade
_FILLED = 8  # times that predictions take the place of lost samples: each is as far off as the gain, of the last
_SAFE = 4.0
"""Times the variance that the likelihood says: a force that comes and goes is small for most of the time."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Scaled, at every sample: motion (n, states) as [x, ẋ, y, ẏ], missing force (n, axes); the standard deviations
    (axes,) of the force.
    """

    motion: Array
    force: Array
    force_deviation: Array


@dataclass(frozen=True, eq=False)
class _Settled:
    """A filter whose gain has settled."""

    parts: Augmented
    covariance: Array
    gain: Array
    spread: Array  # of the innovations


def _settled(record: Beside, latent: Latent) -> _Settled:
    """Raises ModelError where no gain settles."""
    parts = augmented(latent, record.transition, record.step, record.force_noise)
    seen, noise = parts.seen, np.diag(record.noise**2)
    try:
        covariance = solve_discrete_are(parts.transition.T, seen.T, parts.noise, noise)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ModelError("no gain of a latent force settles") from error
    spread = seen @ covariance @ seen.T + noise
    return _Settled(parts, covariance, covariance @ seen.T @ np.linalg.inv(spread), spread)


def _pass(record: Beside, settled: _Settled, start: Array, rows: slice, *, smooth: bool) -> tuple[Array, Array]:
    """States (n, m) as predicted, or as smoothed (Bryson and Frazier), and innovations (n, axes), 0 where a sample is
    lost: there the prediction stands for it.
    """
    seen, own = settled.parts.seen, record.innovation[rows]
    carried = settled.parts.transition @ settled.gain
    closed = settled.parts.transition - carried @ seen
    there = np.isfinite(own)
    sense = np.where(there, own, 0.0)
    for _ in range(1 if there.all() else _FILLED):
        entered = np.zeros((len(own), len(start)))
        entered[:, : record.states] = record.moved[rows]
        entered[1:] += sense[:-1] @ carried.T
        entered[0] = start
        states = _through(closed, entered)
        sense = np.where(there, own, states @ seen.T)
    innovation = sense - states @ seen.T
    if not smooth:
        return states, innovation
    told = (innovation @ np.linalg.inv(settled.spread)) @ seen
    return states + _through(closed.T, told[::-1])[::-1] @ settled.covariance, innovation


def _through(step: Array, entered: Array) -> Array:
    """x (n, m) with x[k] = step x[k − 1] + entered[k], state by state of the triangle that `step` is (Schur): a mode of
    the force may be as good as one of the motion, and eigenvectors would be none.
    """
    triangle, basis = schur(step, output="complex")
    inputs = (entered @ basis.conj()).T
    states = np.zeros_like(inputs)
    for k in reversed(range(len(step))):
        inputs[k, 1:] += triangle[k, k + 1 :] @ states[k + 1 :, :-1]
        states[k] = lfilter([1.0], [1.0, -triangle[k, k]], inputs[k])
    return np.asarray(np.real(states.T @ basis.T))


def _start(record: Beside, settled: _Settled, first: int, length: int) -> Array:
    """The prediction of sample `first`: the motion from which the innovations of so many samples are least."""
    rows, x = slice(first, first + length), np.zeros(len(settled.gain))
    _, innovation = _pass(record, settled, x, rows, smooth=False)
    closed = settled.parts.transition @ (np.eye(len(x)) - settled.gain @ settled.parts.seen)
    entered = np.zeros((record.states, len(innovation), len(x)))
    entered[range(record.states), 0, range(record.states)] = 1.0
    shown = np.stack([(_through(closed, one) @ settled.parts.seen.T).ravel() for one in entered], axis=1)
    x[: record.states] = np.linalg.lstsq(shown, innovation.ravel(), rcond=None)[0]
    return x


def _likelihood(record: Beside, stretches: Sequence[slice], latent: Latent) -> float:
    """Twice the log-likelihood of these rows, but for a constant."""
    try:
        settled = _settled(record, latent)
    except ModelError:
        return -np.inf
    cycle = int(2.0 * np.pi / record.step)
    total = 0.0
    for rows in stretches:
        x = _start(record, settled, rows.start, min(10 * cycle, rows.stop - rows.start))
        _, innovation = _pass(record, settled, x, rows, smooth=False)
        innovation = innovation[min(4 * cycle, len(innovation) // 4) :]
        innovation = innovation[np.any(innovation != 0.0, axis=1)]
        weighed = np.sum((innovation @ np.linalg.inv(settled.spread)) * innovation)
        total -= float(weighed) + len(innovation) * float(np.linalg.slogdet(settled.spread)[1])
    return total if np.isfinite(total) else -np.inf


def chosen(record: Beside) -> Latent:
    """The latent force with the largest likelihood of some stretches, one part after another.

    Raises ModelError where none follows the record.
    """
    samples = len(record.innovation)
    length = min(_WINDOW, samples // _WINDOWS)
    firsts = np.linspace(0, samples - length, _WINDOWS).astype(int).tolist()
    worth = partial(_likelihood, record, [slice(first, first + length) for first in firsts])
    frequency = float(np.mean(np.abs(np.angle(np.linalg.eigvals(record.transition))))) / record.step
    best = Latent((_BEGIN,) * PARTS, _CYCLES[1], frequency)
    for _ in range(_ROUNDS):
        before = best
        for part in range(PARTS):
            best = _with_part(best, part, worth)
        best = max((best, *(replace(best, cycles=cycles) for cycles in _CYCLES)), key=worth)
        if best == before:
            break
    if not np.isfinite(worth(best)):
        raise ModelError("no latent force follows this record")
    return best


def _with_part(latent: Latent, part: int, worth: Callable[[Latent], float]) -> Latent:
    """With the variance of one part that is worth most."""

    def of(decade: float) -> float:
        return worth(latent.with_variance(part, 10.0**decade))

    return latent.with_variance(part, 10.0 ** level(of, np.log10(latent.variance[part]), _DECADES, _CLOSE))


def smooth(record: Beside, latent: Latent) -> Smoothed:
    """The motion and the missing force over the whole record.  Raises ModelError where no gain settles."""
    settled = _settled(record, replace(latent, variance=tuple(_SAFE * one for one in latent.variance)))
    rows = slice(0, len(record.innovation))
    x = _start(record, settled, 0, min(int(_BEGINS * 2.0 * np.pi / record.step), rows.stop))
    states, _ = _pass(record, settled, x, rows, smooth=True)
    covariance = _smoothed_covariance(settled)
    return Smoothed(
        motion=record.predicted + states[:, : record.states],
        force=states @ settled.parts.force.T,
        force_deviation=np.sqrt(np.maximum(np.diagonal(settled.parts.force @ covariance @ settled.parts.force.T), 0.0)),
    )


def _smoothed_covariance(settled: _Settled) -> Array:
    """P − P Λ P with Λ = LᵀΛL + HᵀS⁻¹H, L = A (1 − K H): away from both ends."""
    seen, p = settled.parts.seen, settled.covariance
    loop = settled.parts.transition @ (np.eye(len(p)) - settled.gain @ seen)
    information = solve_discrete_lyapunov(loop.T, seen.T @ np.linalg.inv(settled.spread) @ seen)
    return np.asarray(p - p @ information @ p)
