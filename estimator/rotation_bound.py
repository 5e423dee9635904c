"""The posterior Cramér–Rao bound of the rotation since an instant, φ = ∫Ω dt, along a known trajectory.

φ is one more state of the model beside the 13, φ̇ = Ω, which nothing measures: what is known of it comes through its
correlation with the others.  The recursion is that of `estimator.bound` (Tichavský, Muravchik & Nehorai, IEEE Trans.
Signal Processing 46(5), 1998) with that state in it.  An angle that is read off the pattern and corrected for forces
sample by sample obeys it too, but does not go back to what it took off before it knew the constants better; this bound
is that of an estimator that does.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.kernel.compiled import compiled
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings

_TERMS = 12  # of the exponential's series, for steps of a quarter turn at most
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_CHUNK = 4096


def rotation_bound(
    device: Device, settings: ObserverSettings, truth: Array, *, every: int = 1, lost: Array | None = None
) -> tuple[Array, Array]:
    """Least deviations of φ since the settings' `reference` [rad] (rows,) and of the 13 states (rows, 13), SI, after
    every `every`-th sample.

    truth (n, 13) SI at each sample, evenly spaced, of a device of two axes; lost (n, 2) marks samples that carry no
    information.  The first step is linearised at the first sample.  Raises ModelError as the observer does.
    """
    observer = Observer(device, replace(settings, gain=Gain.EKF))
    h, n = observer.h, len(truth)
    scaled = truth / observer.factors
    seen = np.ones((n, 2), bool) if lost is None else ~np.asarray(lost, bool)
    p = np.zeros((14, 14))
    p[np.ix_(observer.estimated_index, observer.estimated_index)] = observer.covariances[0]
    q = np.zeros((14, 14))
    q[4:13, 4:13] = np.diag(_per_constant(observer)) * h
    for axis in range(2):
        a, b = 2 * axis, 2 * axis + 1
        force = float(observer.force_noise[axis])
        q[a, a], q[a, b], q[b, a], q[b, b] = force * h**3 / 3, force * h**2 / 2, force * h**2 / 2, force * h
    walk = float(_per_constant(observer)[2])
    q[6, 6] = 0.0
    reference = math.ceil(settings.reference * device.sample_rate) - 1
    rotation, deviation = np.zeros(n), np.zeros((n, 13))
    before = np.concatenate([scaled[:1], scaled[:-1]])
    for first in range(0, n, _CHUNK):
        rows = slice(first, first + _CHUNK)
        _recursion(
            _transitions(before[rows], h), scaled[rows], seen[rows], p,
            _Noise(q, walk, h, observer.sense_noise), reference - first, rotation[rows], deviation[rows],
        )  # fmt: skip
    kept = slice(every - 1, None, every)
    return rotation[kept] / device.angular_gain, deviation[kept] * np.abs(observer.factors)


class _Noise(NamedTuple):
    """Of a step q (14, 14), of the rate in scaled time, the step h itself, of a sample (2,)."""

    q: Array
    walk: float
    h: float
    sample: Array


@compiled
def _recursion(
    steps: Array, x: Array, seen: Array, p: Array, variances: _Noise, reference: int, rotation: Array, deviation: Array
) -> None:
    """The Riccati recursion over some samples, one measurement after the other; p (14, 14) goes on."""
    q, walk, h, noise = variances
    f = np.eye(14)
    f[13, 6] = h
    jump = np.zeros(14)  # what a unit jump of the rate does: Euler's acceleration, and φ from the middle of the step on
    jump[6], jump[13] = 1.0, 0.5 * h
    for m in range(len(steps)):
        f[:4, :4] = steps[m, :, :4]
        f[:4, 6:13] = steps[m, :, 4:]
        jump[1], jump[3] = x[m, 2], -x[m, 0]
        p[:, :] = f @ p @ f.T + q
        for i in range(14):
            for j in range(14):
                p[i, j] += walk * h * jump[i] * jump[j]
        for axis in range(2):
            if seen[m, axis]:
                position, offset = 2 * axis, 4 + axis
                towards = p[:, position] + p[:, offset]
                variance = towards[position] + towards[offset] + noise[axis]
                for i in range(14):
                    for j in range(14):
                        p[i, j] -= towards[i] * towards[j] / variance
        if m == reference:
            p[13, :] = 0.0
            p[:, 13] = 0.0
        rotation[m] = math.sqrt(max(p[13, 13], 0.0))
        for i in range(13):
            deviation[m, i] = math.sqrt(max(p[i, i], 0.0))


def _per_constant(observer: Observer) -> Array:
    """Variance per scaled second by which each of the nine constants moves as a random walk."""
    walk = np.zeros(9)
    walk[observer.active] = observer.walks
    return walk


def _transitions(x: Array, h: float) -> Array:
    """Derivative of x, ẋ, y, ẏ after a step by themselves and by Ω, k and d before it (rows, 4, 11); x (rows, 13)
    scaled.  What the drive does to the motion within the step is left out of the derivatives by the constants.
    """
    kxx, kyy, kxy, dxx, dyy, dxy = x[:, 7:13].T
    w = x[:, 6]
    a = np.zeros((len(x), 4, 4))
    a[:, 0, 1] = a[:, 2, 3] = 1.0
    a[:, 1] = np.stack([w * w - kxx, -dxx, -kxy, 2.0 * w - dxy], axis=1)
    a[:, 3] = np.stack([-kxy, -dxy - 2.0 * w, w * w - kyy, -dyy], axis=1)
    found = np.zeros((len(x), 4, 11))
    found[:, :, :4] = _exponential(a, h)
    flows = [_exponential(a, 0.5 * h * (node + 1.0)) for node in _NODES]  # the nodes lie symmetrically
    for there, rest, weight in zip(flows, reversed(flows), _WEIGHTS, strict=True):
        px, vx, py, vy = (there @ x[:, :4, None])[:, :, 0].T
        push = np.zeros((len(x), 4, 7))
        push[:, 1] = np.stack([2 * w * px + 2 * vy, -px, 0 * px, -py, -vx, 0 * px, -vy], axis=1)
        push[:, 3] = np.stack([2 * w * py - 2 * vx, 0 * px, -py, -px, 0 * px, -vy, -vx], axis=1)
        found[:, :, 4:] += 0.5 * h * weight * (rest @ push)
    return found


def _exponential(a: Array, t: float) -> Array:
    """exp(a t) of each (rows, 4, 4), by its series."""
    term = total = np.broadcast_to(np.eye(4), a.shape)
    for order in range(1, _TERMS):
        term = term @ a * (t / order)
        total = total + term
    return np.asarray(total)
