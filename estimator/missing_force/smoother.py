"""The unknown force along a record: the motion with a latent force, forward and backward, its size by likelihood.

The model is that of `linear` with the latent force of `latent`; it does not change along the record but for the rate,
so that the gain settles, and a million samples cost seconds.  Around a lost sample the settled gain is not the best
one, and the band is that of the rest of the record.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import schur, solve_discrete_lyapunov
from scipy.signal import lfilter

from estimator.errors import ModelError
from estimator.missing_force.latent import HARMONICS, PARTS, Augmented, Latent, augmented
from estimator.missing_force.linear import Linear
from estimator.scaling import Array

_LEAST = 1e-14  # variance of a part that is not there, scaled
_STEPS = (30.0, 4.0)  # by which variances are changed, one after another
_CYCLES = (4.0, 16.0, 64.0)
_COMPARED = 2_000  # samples of each of the stretches by which variances are chosen
_STRETCHES = 3
_DOUBLINGS = 60
_BEGINS = 40.0  # cycles that tell how a record begins
_FILLED = 8  # times that predictions take the place of lost samples: each is as far off as the gain, of the last
_BALANCE = 5.0  # by which the axes' variances are changed against one another
_SAFE = 4.0
"""Times the variance that the likelihood says: a force that comes and goes is small for most of the time."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Scaled, at every sample: motion (n, states) as [x, ẋ, y, ẏ], missing force (n, axes); the standard deviations
    (axes,) of the force; the latent force that was assumed.
    """

    motion: Array
    force: Array
    force_deviation: Array
    latent: Latent


@dataclass(frozen=True, eq=False)
class _Settled:
    """A filter whose gain has settled."""

    parts: Augmented
    covariance: Array
    gain: Array
    spread: Array  # of the innovations


def _settled(linear: Linear, latent: Latent, force_noise: float) -> _Settled:
    """Raises ModelError where no gain settles."""
    parts = augmented(latent, linear.continuous[0], linear.step, force_noise)
    seen, noise = parts.seen, np.diag(linear.noise**2)
    covariance = _covariance(parts.transition, seen, parts.noise, noise)
    spread = seen @ covariance @ seen.T + noise
    return _Settled(parts, covariance, covariance @ seen.T @ np.linalg.inv(spread), spread)


def _covariance(transition: Array, seen: Array, noise: Array, seen_noise: Array) -> Array:
    """Of the prediction, once it has settled, by doubling (Chu, Fan, Lin & Wang, Int. J. Control 77(8), 2004)."""
    a, g, h = transition.T.copy(), seen.T @ np.linalg.inv(seen_noise) @ seen, noise.copy()
    one = np.eye(len(a))
    with np.errstate(all="ignore"):
        for _ in range(_DOUBLINGS):
            try:
                solved = np.linalg.solve(one + g @ h, np.concatenate([a, g], axis=1))
            except np.linalg.LinAlgError:
                break
            moved, spread = solved[:, : len(a)], solved[:, len(a) :]
            more = a.T @ h @ moved
            g = g + a @ spread @ a.T
            a = a @ moved
            h = h + more
            g, h = 0.5 * (g + g.T), 0.5 * (h + h.T)
            if not np.all(np.isfinite(h)):
                break
            if float(np.max(np.abs(more))) <= 1e-12 * float(np.max(np.abs(h))):
                return h
    raise ModelError("no gain of a latent force settles")


def _pass(
    linear: Linear, settled: _Settled, added: Array, start: Array, rows: slice, *, smooth: bool
) -> tuple[Array, Array]:
    """States (n, m) as predicted, or as smoothed (Bryson and Frazier), and innovations (n, axes), 0 where a sample is
    lost: there the prediction stands for it.
    """
    seen, own = settled.parts.seen, linear.sense[rows] - linear.offset
    carried = settled.parts.transition @ settled.gain
    closed = settled.parts.transition - carried @ seen
    there = np.isfinite(own)
    sense = np.where(there, own, 0.0)
    for _ in range(1 if there.all() else _FILLED):
        entered = np.zeros((len(own), len(start)))
        entered[:, : linear.states] = added[rows]
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


def _start(linear: Linear, settled: _Settled, added: Array, first: int, length: int) -> Array:
    """The prediction of sample `first`: the motion from which the innovations of so many samples are least."""
    rows, x = slice(first, first + length), np.zeros(len(settled.gain))
    _, innovation = _pass(linear, settled, added, x, rows, smooth=False)
    closed = settled.parts.transition @ (np.eye(len(x)) - settled.gain @ settled.parts.seen)
    entered = np.zeros((linear.states, len(innovation), len(x)))
    entered[range(linear.states), 0, range(linear.states)] = 1.0
    shown = np.stack([(_through(closed, one) @ settled.parts.seen.T).ravel() for one in entered], axis=1)
    x[: linear.states] = np.linalg.lstsq(shown, innovation.ravel(), rcond=None)[0]
    return x


def _likelihood(linear: Linear, latent: Latent, force_noise: float, stretches: Sequence[slice]) -> float:
    """Twice the log-likelihood of these rows, but for a constant."""
    try:
        settled = _settled(linear, latent, force_noise)
    except ModelError:
        return -np.inf
    cycle = int(2.0 * np.pi / linear.step)
    total = 0.0
    for rows in stretches:
        x = _start(linear, settled, linear.driven, rows.start, min(10 * cycle, rows.stop - rows.start))
        _, innovation = _pass(linear, settled, linear.driven, x, rows, smooth=False)
        innovation = innovation[min(4 * cycle, len(innovation) // 4) :]
        innovation = innovation[np.any(innovation != 0.0, axis=1)]
        weighed = np.sum((innovation @ np.linalg.inv(settled.spread)) * innovation)
        total -= float(weighed) + len(innovation) * float(np.linalg.slogdet(settled.spread)[1])
    return total if np.isfinite(total) else -np.inf


def chosen(linear: Linear, force_noise: float) -> Latent:
    """The latent force with the largest likelihood of some stretches, one part after another."""
    samples = len(linear.sense)
    length = min(_COMPARED, samples // _STRETCHES)
    firsts = np.linspace(0, samples - length, _STRETCHES).astype(int).tolist()
    stretches = [slice(first, first + length) for first in firsts]
    reached: dict[Latent, float] = {}

    def worth(latent: Latent) -> float:
        if latent not in reached:
            reached[latent] = _likelihood(linear, latent, force_noise, stretches)
        return reached[latent]

    frequency = float(np.sqrt(max(_stiffness(linear), 0.01)))
    best = Latent((1e-7, *(1e-6 for _ in HARMONICS), 1e-7), _CYCLES[1], frequency)
    for step in _STEPS:
        for _ in range(4):
            before = best
            for part in range(PARTS):
                best = _climbed(best, part, step, worth)
            best = max((best, *(replace(best, cycles=cycles) for cycles in _CYCLES)), key=worth)
            if linear.axes == 2:
                near = (replace(best, balance=best.balance * factor) for factor in (_BALANCE, 1.0 / _BALANCE))
                best = max((best, *near), key=worth)
            if best == before:
                break
    if not np.isfinite(worth(best)):
        raise ModelError("no latent force follows this record")
    return best


def _climbed(latent: Latent, part: int, step: float, worth: Callable[[Latent], float]) -> Latent:
    for factor in (step, 1.0 / step):
        moved = False
        while True:
            value = latent.variance[part] * factor
            if not _LEAST <= value <= 1e2:
                break
            trial = latent.with_variance(part, value)
            if worth(trial) <= worth(latent):
                break
            latent, moved = trial, True
        if moved:
            break
    return latent


def _stiffness(linear: Linear) -> float:
    named = [linear.constants[name] for name in ("kxx", "kyy") if name in linear.constants]
    return float(np.mean(named)) if named else 1.0


def smooth(linear: Linear, latent: Latent, known: Array | None, force_noise: float) -> Smoothed:
    """The motion and the missing force over the whole record; known (n, states): what is known to push besides the
    drive, over each interval.

    Raises ModelError where no gain settles.
    """
    settled = _settled(linear, latent.widened(_SAFE), force_noise)
    added = linear.driven if known is None else linear.driven + known
    rows = slice(0, len(linear.sense))
    x = _start(linear, settled, added, 0, min(int(_BEGINS * 2.0 * np.pi / linear.step), rows.stop))
    states, _ = _pass(linear, settled, added, x, rows, smooth=True)
    covariance = _smoothed_covariance(settled)
    return Smoothed(
        motion=states[:, : linear.states],
        force=states @ settled.parts.force.T,
        force_deviation=np.sqrt(np.maximum(np.diagonal(settled.parts.force @ covariance @ settled.parts.force.T), 0.0)),
        latent=latent,
    )


def _smoothed_covariance(settled: _Settled) -> Array:
    """P − P Λ P with Λ = LᵀΛL + HᵀS⁻¹H, L = A (1 − K H): away from both ends."""
    seen, p = settled.parts.seen, settled.covariance
    loop = settled.parts.transition @ (np.eye(len(p)) - settled.gain @ seen)
    information = solve_discrete_lyapunov(loop.T, seen.T @ np.linalg.inv(settled.spread) @ seen)
    return np.asarray(p - p @ information @ p)
