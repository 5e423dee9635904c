"""The unknown force along a record: the motion with a latent force, forward and backward, its size by likelihood.

The model is that of `linear` with the latent force of `latent`; it does not change along the record but for the rate,
so that the gain settles, and a million samples cost seconds.  Around a lost sample the settled gain is not the best
one, and the band is that of the rest of the record.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from estimator.errors import ModelError
from estimator.missing_force.latent import HARMONICS, PARTS, Augmented, Latent, augmented
from estimator.missing_force.linear import Linear, jumps
from estimator.missing_force.passes import Settled
from estimator.scaling import Array

_LEAST = 1e-14  # variance of a part that is not there, scaled
_STEPS = (30.0, 4.0)  # by which variances are changed, one after another
_CYCLES = (4.0, 16.0, 64.0)
_COMPARED = 2_000  # samples of each of the stretches by which variances are chosen
_STRETCHES = 3
_DOUBLINGS = 60
_BLOCK = 200_000  # samples that are smoothed at a time
_BESIDE = 40.0  # cycles that blocks overlap by on either side
_STARTS = 3
_BALANCE = 5.0  # by which the axes' variances are changed against one another
_SAFE = 4.0
"""Times the variance that the likelihood says: a force that comes and goes is small for most of the time."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Scaled, at every sample: motion (n, states) as [x, ẋ, y, ẏ], missing force (n, axes); their standard deviations
    (states,), (axes,); the latent force that was assumed.
    """

    motion: Array
    force: Array
    motion_deviation: Array
    force_deviation: Array
    latent: Latent

    @property
    def rms(self) -> float:
        """Of the force, what is not known of it included: √⟨f̂² + σ²⟩ over both axes."""
        return float(np.sqrt(np.mean(self.force**2) + np.mean(self.force_deviation**2)))


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
    over = Settled(
        transition=settled.parts.transition, by_rate=linear.by_rate, turning=linear.turning[rows], added=added[rows],
        sense=linear.sense[rows] - linear.offset, seen=settled.parts.seen, gain=settled.gain, start=start,
        weight=np.asarray(np.linalg.inv(settled.spread), dtype=float), covariance=settled.covariance,
    )  # fmt: skip
    over.forward()
    if smooth:
        over.backward()
    return over.states, over.innovation


def _start(linear: Linear, settled: _Settled, added: Array, first: int, length: int) -> Array:
    """The prediction of sample `first`: what smoothing finds there, begun with what it found."""
    x = np.zeros(len(settled.gain))
    seen = np.nan_to_num(linear.sense[first] - linear.offset)
    x[np.arange(linear.axes) * 2] = seen
    for _ in range(_STARTS):
        states, _ = _pass(linear, settled, added, x, slice(first, first + length), smooth=True)
        x = states[0].copy()
    return x


def _likelihood(linear: Linear, latent: Latent, added: Array, force_noise: float, stretches: Sequence[slice]) -> float:
    """Twice the log-likelihood of these rows, but for a constant."""
    try:
        settled = _settled(linear, latent, force_noise)
    except ModelError:
        return -np.inf
    cycle = int(2.0 * np.pi / linear.step)
    total = 0.0
    for rows in stretches:
        x = _start(linear, settled, added, rows.start, min(10 * cycle, rows.stop - rows.start))
        _, innovation = _pass(linear, settled, added, x, rows, smooth=False)
        innovation = innovation[min(4 * cycle, len(innovation) // 4) :]
        innovation = innovation[np.any(innovation != 0.0, axis=1)]
        weighed = np.sum((innovation @ np.linalg.inv(settled.spread)) * innovation)
        total -= float(weighed) + len(innovation) * float(np.linalg.slogdet(settled.spread)[1])
    return total if np.isfinite(total) else -np.inf


def chosen(
    linear: Linear, known: Array | None, force_noise: float, *, rows: slice | None = None, begin: Latent | None = None
) -> Latent:
    """The latent force with the largest likelihood of stretches of `rows`, one part after another; from `begin` on,
    where given.
    """
    rows = slice(0, len(linear.sense)) if rows is None else rows
    length = min(_COMPARED, (rows.stop - rows.start) // _STRETCHES)
    firsts = np.linspace(rows.start, rows.stop - length, _STRETCHES).astype(int).tolist()
    stretches = [slice(first, first + length) for first in firsts]
    added = linear.driven if known is None else linear.driven + known
    reached: dict[Latent, float] = {}

    def worth(latent: Latent) -> float:
        if latent not in reached:
            reached[latent] = _likelihood(linear, latent, added, force_noise, stretches)
        return reached[latent]

    frequency = float(np.sqrt(max(_stiffness(linear), 0.01)))
    best = begin or Latent((1e-7, *(1e-6 for _ in HARMONICS), 1e-7), _CYCLES[1], frequency)
    for step in _STEPS[1:] if begin else _STEPS:
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
    n, size = len(linear.sense), linear.states
    motion, force = np.zeros((n, size)), np.zeros((n, linear.axes))
    beside = int(_BESIDE * 2.0 * np.pi / linear.step)
    for begin in range(0, n, _BLOCK):
        first, last = max(begin - beside, 0), min(begin + _BLOCK + beside, n)
        x = _start(linear, settled, added, first, min(beside, last - first))
        states, _ = _pass(linear, settled, added, x, slice(first, last), smooth=True)
        own = slice(begin - first, min(begin + _BLOCK, n) - first)
        motion[begin : begin + _BLOCK] = states[own, :size]
        force[begin : begin + _BLOCK] = states[own] @ settled.parts.force.T
    covariance = _smoothed_covariance(settled)
    return Smoothed(
        motion=motion,
        force=force,
        motion_deviation=np.sqrt(np.maximum(np.diagonal(covariance)[:size], 0.0)),
        force_deviation=np.sqrt(np.maximum(np.diagonal(settled.parts.force @ covariance @ settled.parts.force.T), 0.0)),
        latent=latent,
    )


def _smoothed_covariance(settled: _Settled) -> Array:
    """P − P Λ P with Λ = LᵀΛL + HᵀS⁻¹H, L = A (1 − K H): away from both ends."""
    seen, p = settled.parts.seen, settled.covariance
    loop = settled.parts.transition @ (np.eye(len(p)) - settled.gain @ seen)
    information = solve_discrete_lyapunov(loop.T, seen.T @ np.linalg.inv(settled.spread) @ seen)
    return np.asarray(p - p @ information @ p)


def euler(linear: Linear, motion: Array) -> Array:
    """What the changes of the rate add, along a motion (n, states)."""
    return jumps(motion, linear.rate) if linear.axes == 2 else np.zeros((len(motion), 2))
