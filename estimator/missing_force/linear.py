"""The base model with constants that are known, as a linear step from sample to sample.

Scaled as in the observer: time by 1/ω0, length by the nominal amplitude.  What forces do over one interval goes in as
an increment of the state at its end.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import expm

from estimator.model.catalogue import model_for
from estimator.oracle.evaluation import evaluated
from estimator.scaling import Array

_CHANGE = 1e-4  # of a scaled rate, for its derivative


def field(axes: int, constants: Mapping[str, float]) -> tuple[Array, Array]:
    """M (states, states) and N (states, axes) of ṡ = M s + N u, by scaled constants of the model."""
    number, model = model_for(axes)
    return evaluated(number).matrices(np.array([constants.get(one.name, 0.0) for one in model.constants]))


@dataclass(frozen=True, eq=False)
class Linear:
    """A record in scaled units, and the model that it is compared with.

    sense (n, axes), lost samples NaN; drive (n, axes, degree + 1); step: of every interval; noise (axes,): standard
    deviation of a sample; constants: of the model, without rate and offsets; offset (axes,); rate (n,).
    """

    sense: Array
    drive: Array
    step: float
    noise: Array
    constants: Mapping[str, float]
    offset: Array
    rate: Array

    @property
    def axes(self) -> int:
        """1 or 2."""
        return int(self.sense.shape[1])

    @property
    def states(self) -> int:
        """Of the motion."""
        return 2 * self.axes

    @cached_property
    def mean_rate(self) -> float:
        """About which the step is expanded."""
        return float(np.mean(self.rate)) if len(self.rate) else 0.0

    @cached_property
    def continuous(self) -> tuple[Array, Array]:
        """M and N at the mean rate."""
        return field(self.axes, {**self.constants, "rate": self.mean_rate})

    @cached_property
    def by_rate(self) -> Array:
        """The derivative of exp(M h) by the rate; zeros for a single axis."""
        if self.axes == 1:
            return np.zeros((2, 2))
        ends = [
            expm(field(2, {**self.constants, "rate": self.mean_rate + change})[0] * self.step)
            for change in (_CHANGE, -_CHANGE)
        ]
        return np.asarray((ends[0] - ends[1]) / (2.0 * _CHANGE))

    @cached_property
    def driven(self) -> Array:
        """What the drive adds to the state over the interval that ends at each sample, (n, states)."""
        m, n = self.continuous
        size, axes, degree = self.states, self.axes, self.drive.shape[2]
        # ∫ exp(M (h − t)) N (t/h)^p dt by an augmented exponential: t^p/p! is a chain of integrators.
        total = np.zeros((len(self.drive), size))
        for axis in range(axes):
            chain = np.zeros((size + degree, size + degree))
            chain[:size, :size] = m
            chain[:size, size] = n[:, axis]
            for p in range(degree - 1):
                chain[size + p, size + p + 1] = 1.0
            moved = expm(chain * self.step)[:size, size:]
            scale = np.array([math.factorial(p) / self.step**p for p in range(degree)])
            total += self.drive[:, axis] @ (moved * scale).T
        return total


def turned(linear: Linear, motion: Array) -> Array:
    """What a rate beside its mean adds to the state over each interval, along a motion (n, states): its Coriolis force,
    and of its changes the Euler force as an impulse, which speaks of velocities, not of momenta (`Constant.jump`).
    """
    added = np.zeros_like(motion)
    if linear.axes == 2:
        change = np.diff(linear.rate, prepend=linear.rate[:1])
        added[1:] = (motion[:-1] @ linear.by_rate.T) * (linear.rate[1:] - linear.mean_rate)[:, None]
        added[:, 1] += motion[:, 2] * change
        added[:, 3] -= motion[:, 0] * change
    return added
