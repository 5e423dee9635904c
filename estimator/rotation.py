"""The rotation since an instant, φ = ∫Ω dt, as one more state of the model beside the 13, φ̇ = Ω.

Nothing measures φ; what a sample says of it comes through its correlation with the others.  That is how it differs from
an angle that is read off the pattern and corrected for forces sample by sample: what was taken off for forces by
constants that are known better later is put right then, as far as the correlation remembers it.

`Rotation` is the estimate on a record, beside an observer of 13 states by the plain EKF, of which it takes the states
and the innovations; `rotation_bound` is the same recursion along the truth.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.core.arguments import Arguments
from estimator.core.library import LIBRARY
from estimator.errors import ModelError
from estimator.observer import Estimates, Observer
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings, Variant

_TERMS = 12  # of the exponential's series, for steps of a quarter turn at most
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


class Rotation:
    """What is known of φ from sample to sample, beside an observer that has not begun."""

    def __init__(self, observer: Observer) -> None:
        """Raises ModelError where that is not of 13 states without effects on two axes, with the gain of an EKF."""
        settings, device = observer.settings, observer.device
        if device.axes != 2 or settings.variant is not Variant.FULL or settings.gain is not Gain.EKF:
            raise ModelError("the rotation is carried beside 13 states with the gain of an EKF; take those")
        if observer.effects:
            raise ModelError("the rotation is carried beside the base model alone; leave the effects out")
        self._recursion = Recursion(observer)
        self._factors = observer.factors
        self._volts = observer.volts
        self._before = observer.x.copy()
        self._rotation = 0.0
        self._turns = 1.0 / device.angular_gain

    def follow(self, estimates: Estimates, sense: Array) -> tuple[Array, Array]:
        """Estimate and standard deviation of φ (n,) [rad] after each of the next n samples, sense (n, 2) [V], of which
        `estimates` has every row; NaN marks a sample that was lost.

        The deviation is that of the change since the settings' `reference`; the estimate goes on.
        """
        after = estimates.state / self._factors
        before = np.concatenate([self._before[None], after[:-1]])
        seen = np.isfinite(sense)
        innovation = np.where(seen, estimates.innovation / self._volts, 0.0)
        found = self._recursion.go(before, before, seen, innovation)
        rotation = self._rotation + found.rotation
        self._before, self._rotation = after[-1], float(rotation[-1])
        return self._turns * rotation, self._turns * found.deviation


class Followed(NamedTuple):
    """Of each of n samples, scaled: estimate of φ since the first of them and its deviation since the reference (n,),
    deviations of the 13 states (n, 13).
    """

    rotation: Array
    deviation: Array
    states: Array


class _Noise(NamedTuple):
    """Of a step q (14, 14), of the rate in scaled time, the step h itself, of a sample (2,)."""

    q: Array
    rate: float
    h: float
    sample: Array


_TURNING = Arguments("rotation.h", "Turning")


class Recursion:
    """The covariance of 13 states and φ from the beginning of `observer`, an EKF's, which has not begun."""

    def __init__(self, observer: Observer) -> None:
        h = observer.h
        self._p = np.zeros((14, 14))
        self._p[np.ix_(observer.estimated_index, observer.estimated_index)] = observer.covariances[0]
        q = np.zeros((14, 14))
        intensity = np.zeros(9)
        intensity[observer.active] = observer.random_walk_intensity
        q[4:13, 4:13] = np.diag(intensity) * h
        for axis in range(2):
            a, b = 2 * axis, 2 * axis + 1
            force = float(observer.force_noise[axis])
            q[a, a], q[a, b], q[b, a], q[b, b] = force * h**3 / 3, force * h**2 / 2, force * h**2 / 2, force * h
        q[6, 6] = 0.0
        self._noise = _Noise(q, float(intensity[2]), h, observer.sense_noise)
        self._reference = math.ceil(observer.settings.reference * observer.device.sample_rate) - 1
        self._done = 0

    def go(self, before: Array, here: Array, seen: Array, innovation: Array) -> Followed:
        """Over the next n steps, each linearised at `before` (n, 13), its random walk of the rate at `here`; seen
        (n, 2) says which channels were, innovation (n, 2) what they were off by, scaled.
        """
        n = len(before)
        found = Followed(np.zeros(n), np.zeros(n), np.zeros((n, 13)))
        LIBRARY.gyro_turning(
            _TURNING(
                n=n, steps=_transitions(before, self._noise.h), rate=np.ascontiguousarray(before[:, 6]),
                x=np.ascontiguousarray(here), seen=np.ascontiguousarray(seen, dtype=bool),
                innovation=np.ascontiguousarray(innovation), p=self._p, q=self._noise.q, noise=self._noise.sample,
                rate_intensity=self._noise.rate, h=self._noise.h, reference=self._reference - self._done,
                **found._asdict(),
            )
        )  # fmt: skip
        self._done += n
        return found


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


_CHUNK = 4096


def rotation_bound(
    device: Device, settings: ObserverSettings, truth: Array, *, every: int = 1, lost: Array | None = None
) -> tuple[Array, Array]:
    """The posterior Cramér–Rao bound: least deviations of φ since the settings' `reference` [rad] (rows,) and of the 13
    states (rows, 13), SI, after every `every`-th sample.

    The recursion is that of `estimator.bound` (Tichavský, Muravchik & Nehorai, IEEE Trans. Signal Processing 46(5),
    1998) with φ in it.  An angle that is read off the pattern and corrected for forces sample by sample obeys the bound
    too, but does not go back to what it took off before it knew the constants better.

    truth (n, 13) SI at each sample, evenly spaced, of a device of two axes; lost (n, 2) marks samples that carry no
    information.  The first step is linearised at the first sample.  Raises ModelError as the observer does.
    """
    observer = Observer(device, replace(settings, gain=Gain.EKF))
    recursion, n = Recursion(observer), len(truth)
    scaled = truth / observer.factors
    seen = np.ones((n, 2), bool) if lost is None else ~np.asarray(lost, bool)
    rotation, deviation = np.zeros(n), np.zeros((n, 13))
    before = np.concatenate([scaled[:1], scaled[:-1]])
    for first in range(0, n, _CHUNK):
        rows = slice(first, first + _CHUNK)
        found = recursion.go(before[rows], scaled[rows], seen[rows], np.zeros_like(scaled[rows, :2]))
        rotation[rows], deviation[rows] = found.deviation, found.states
    kept = slice(every - 1, None, every)
    return rotation[kept] / device.angular_gain, deviation[kept] * np.abs(observer.factors)
