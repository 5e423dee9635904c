"""A filter of the motion and, in a plane, of the rate, and what each force asked about makes of its innovations.

The motion at which forces and the Coriolis force are evaluated is given, so that everything is linear: constants,
coefficients and the innovation itself belong to one least-squares problem.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from estimator.core.arguments import Arguments
from estimator.core.library import LIBRARY
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
    LIBRARY.gyro_follow_force(
        _FILTER(
            n=n, axes=axes, states=size, followed=m, **_steps(linear, reference), added=added, sense=z,
            seen_noise=linear.noise**2, noise=noise, start=start, spread=spread,
            rate_variance=rate_intensity * linear.step, innovation=innovation, variance=variance, gain=gain, rate=rate,
            predicted=np.zeros((n, m, m)), predictions=np.zeros((n, m)), transitions=np.zeros((n, size, m)),
        )
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
    n, axes, columns = sensed.shape
    out = np.zeros((n, axes, columns))
    m = followed.gain.shape[1]
    LIBRARY.gyro_force_signatures(
        _FILTER(n=n, axes=axes, states=linear.states, followed=m, **_steps(linear, reference), gain=followed.gain),
        _ASKED(
            columns=columns, pushed=np.ascontiguousarray(pushed), sensed=np.ascontiguousarray(sensed),
            scratch=np.zeros((2 * m, columns)), out=out,
        ),
    )  # fmt: skip
    return out


_FILTER = Arguments(
    ("n", "axes", "states", "followed"),
    (
        "transition", "by_rate", "turning", "added", "sense", "reference", "seen_noise", "noise", "start", "spread",
        "innovation", "variance", "gain", "rate", "predicted", "predictions", "transitions",
    ),
    ("rate_variance",),
)  # fmt: skip
_ASKED = Arguments(("columns",), ("pushed", "sensed", "scratch", "out"))
"""`Force_filter` and `Force_columns` of estimator/core/missing_force.h."""


def _steps(linear: Linear, reference: Array) -> dict[str, Array]:
    """What the transition from sample to sample is made of."""
    return {
        "transition": np.ascontiguousarray(linear.transition),
        "by_rate": np.ascontiguousarray(linear.by_rate),
        "turning": np.ascontiguousarray(linear.turning),
        "reference": np.ascontiguousarray(reference),
    }


def _force_noise(linear: Linear, density: float) -> Array:
    m, size = linear.continuous[0], linear.states
    white = np.zeros((size, size))
    white[1::2, 1::2] = density * np.eye(linear.axes)
    both = expm(np.block([[-m, white], [np.zeros_like(m), m.T]]) * linear.step)
    return np.asarray(both[size:, size:].T @ both[:size, size:])
