"""A filter of the motion and, in a plane, of the rate, and what each force asked about makes of its innovations.

The motion at which forces and the Coriolis force are evaluated is given, so that everything is linear: constants,
coefficients and the innovation itself belong to one least-squares problem.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from estimator.kernel.compiled import compiled
from estimator.missing_force.linear import Linear
from estimator.scaling import Array


@dataclass(frozen=True, eq=False)
class Followed:
    """innovation (n, axes), its deviation (n, axes), the gains (n, m, axes), the rate as smoothed (n,), and twice the
    log-likelihood, but for a constant.
    """

    innovation: Array
    deviation: Array
    gain: Array
    rate: Array
    likelihood: float


def follow(
    linear: Linear, reference: Array, known: Array, sensed: Array, force_noise: float, rate_intensity: float
) -> Followed:
    """Over the record; reference (n, states): the motion; known (n, states): what is known to push besides the drive;
    sensed (n, axes): what is known to be sensed besides the position; force_noise: density of a white force;
    rate_intensity: variance by which the rate wanders per unit of scaled time.
    """
    axes, size = linear.axes, linear.states
    m = size + (axes == 2)
    noise = np.zeros((m, m))
    noise[:size, :size] = _force_noise(linear, force_noise)
    start = np.zeros(m)
    start[:size] = reference[0]
    spread = np.diag([1e-4] * size + [1e-4] * (m - size))
    z = np.ascontiguousarray(linear.sense - linear.offset - sensed)
    added = np.ascontiguousarray(linear.driven + known)
    n = len(z)
    innovation, variance, gain = np.zeros((n, axes)), np.zeros((n, axes, axes)), np.zeros((n, m, axes))
    rate = np.zeros(n)
    turning, expected = np.ascontiguousarray(linear.turning), np.ascontiguousarray(reference)
    _follow(
        _Noise(linear.noise**2, noise, rate_intensity * linear.step),
        _Course(np.ascontiguousarray(linear.transition), linear.by_rate, turning, added, z, expected),
        start, spread, innovation, variance, gain, rate,
    )  # fmt: skip
    there = np.all(np.isfinite(z), axis=1)
    there[: n // 50] = False
    left, own = innovation[there], variance[there]
    with np.errstate(all="ignore"):
        weighed = np.einsum("na,nab,nb->", left, np.linalg.inv(own), left) if len(left) else 0.0
        likelihood = -float(weighed) - float(np.sum(np.linalg.slogdet(own)[1]))
    return Followed(
        innovation,
        np.sqrt(np.diagonal(variance, axis1=1, axis2=2)),
        gain,
        linear.rate + rate,
        likelihood if np.isfinite(likelihood) else -np.inf,
    )


def signatures(linear: Linear, reference: Array, followed: Followed, pushed: Array, sensed: Array) -> Array:
    """What unit coefficients make of the innovations (n, axes, columns): pushed (n, states, columns), sensed (n, axes,
    columns).
    """
    out = np.zeros(sensed.shape)
    _signatures(
        np.ascontiguousarray(linear.transition), linear.by_rate, np.ascontiguousarray(linear.turning),
        np.ascontiguousarray(reference), followed.gain, pushed, sensed, out,
    )  # fmt: skip
    return out


def _force_noise(linear: Linear, density: float) -> Array:
    m, size = linear.continuous[0], linear.states
    white = np.zeros((size, size))
    white[1::2, 1::2] = density * np.eye(linear.axes)
    both = expm(np.block([[-m, white], [np.zeros_like(m), m.T]]) * linear.step)
    return np.asarray(both[size:, size:].T @ both[:size, size:])


@compiled
def _step(transition, by_rate, turning, before, a):  # type: ignore[no-untyped-def]
    """Rows of the motion in the transition over one sample at a known rate, and what a rate beside it adds."""
    s = by_rate.shape[0]
    for i in range(s):
        for j in range(s):
            a[i, j] = transition[i, j] + turning * by_rate[i, j]
        if a.shape[1] > s:
            a[i, s] = 0.0
            for j in range(s):
                a[i, s] += by_rate[i, j] * before[j]


class _Noise(NamedTuple):
    """Variances of a sample (axes,), of the motion (m, m) and of the rate from one sample to the next."""

    seen: Array
    motion: Array
    rate: float


class _Course(NamedTuple):
    """What is known of the record beforehand, as `follow` has it."""

    transition: Array
    by_rate: Array
    turning: Array
    added: Array
    sense: Array
    reference: Array


@compiled
def _follow(  # type: ignore[no-untyped-def]
    variances, course, start, spread, innovation, variance, gain, rate
):
    seen_noise, noise, rate_variance = variances
    transition, by_rate, turning, added, sense, reference = course
    n, axes = sense.shape
    s = by_rate.shape[0]
    m = len(start)
    x, p = start.copy(), spread.copy()
    a = np.zeros((m, m))
    predicted = np.zeros((n, m, m))
    states = np.zeros((n, m))
    transitions = np.zeros((n, s, m))
    push = np.zeros(m)
    for k in range(n):
        if k > 0:
            _step(transition, by_rate, turning[k], reference[k - 1], a)
            if m > s:
                a[s, s] = 1.0
            transitions[k] = a[:s]
            x = a @ x
            for i in range(s):
                x[i] += added[k, i]
            p = a @ p @ a.T + noise
            if m > s:
                change = turning[k] - turning[k - 1]  # Euler: the rate that is known, and the random walk of the rest
                x[1] += reference[k, 2] * change
                x[3] -= reference[k, 0] * change
                push[1], push[3], push[4] = reference[k, 2], -reference[k, 0], 1.0
                for i in range(m):
                    for j in range(m):
                        p[i, j] += rate_variance * push[i] * push[j]
            for i in range(m):
                for j in range(i):
                    p[i, j] = 0.5 * (p[i, j] + p[j, i])
                    p[j, i] = p[i, j]
        predicted[k] = p
        states[k] = x
        own = np.zeros((axes, axes))
        for i in range(axes):
            for j in range(axes):
                own[i, j] = p[2 * i, 2 * j]
            own[i, i] += seen_noise[i]
        variance[k] = own
        lost = False
        for i in range(axes):
            if not np.isfinite(sense[k, i]):
                lost = True
        if lost:
            continue
        inverse = np.linalg.inv(own)
        for i in range(axes):
            innovation[k, i] = sense[k, i] - x[2 * i]
        for i in range(m):
            for j in range(axes):
                total = 0.0
                for b in range(axes):
                    total += p[i, 2 * b] * inverse[b, j]
                gain[k, i, j] = total
        for i in range(m):
            for j in range(axes):
                x[i] += gain[k, i, j] * innovation[k, j]
        rows = np.zeros((axes, m))
        for b in range(axes):
            rows[b] = p[2 * b]
        p = p - np.ascontiguousarray(gain[k]) @ rows
    if m == s:
        return
    adjoint = np.zeros(m)
    for k in range(n - 1, -1, -1):
        back = np.zeros(m)
        if k + 1 < n:
            for i in range(m):
                for j in range(s):
                    back[i] += transitions[k + 1, j, i] * adjoint[j]
            back[s] += adjoint[s]
        adjoint = back.copy()
        if innovation[k, 0] != 0.0 or innovation[k, axes - 1] != 0.0:
            weighed = np.linalg.inv(variance[k]) @ innovation[k]
            for j in range(axes):
                total = weighed[j]
                for i in range(m):
                    total -= gain[k, i, j] * back[i]
                adjoint[2 * j] += total
        rate[k] = states[k, s]
        for j in range(m):
            rate[k] += predicted[k, s, j] * adjoint[j]


@compiled
def _signatures(transition, by_rate, turning, reference, gain, pushed, sensed, out):  # type: ignore[no-untyped-def]
    n, axes, columns = sensed.shape
    s = by_rate.shape[0]
    m = gain.shape[1]
    e = np.zeros((m, columns))
    f = np.zeros((m, columns))
    a = np.zeros((s, m))
    for k in range(n):
        if k > 0:
            _step(transition, by_rate, turning[k], reference[k - 1], a)
            for i in range(s):
                for c in range(columns):
                    f[i, c] = pushed[k, i, c]
                for j in range(m):
                    factor = a[i, j]
                    for c in range(columns):
                        f[i, c] += factor * e[j, c]
            if m > s:
                for c in range(columns):
                    f[s, c] = e[s, c]
            for i in range(m):
                for c in range(columns):
                    e[i, c] = f[i, c]
        for b in range(axes):
            for c in range(columns):
                out[k, b, c] = e[2 * b, c] + sensed[k, b, c]
        for i in range(m):
            for b in range(axes):
                factor = gain[k, i, b]
                if factor != 0.0:
                    for c in range(columns):
                        e[i, c] -= factor * out[k, b, c]
