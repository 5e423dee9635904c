"""The base model with constants that are known, as a linear step from sample to sample.

Scaled as in the observer: time by 1/ω0, length by the nominal amplitude.  What forces do over one interval goes in as
an increment of the state at its end.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import sympy as sp
from scipy.linalg import expm

from estimator.model.catalogue import model_for
from estimator.observer import Observer
from estimator.scaling import Array

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, eq=False)
class Rule:
    """Instants of an interval at which a force is asked, as shares of it (nodes,), and their weights (nodes,)."""

    nodes: Array
    weights: Array


def _panels(count: int) -> Rule:
    """Gauss and Legendre, exact to degree 5 on each of so many panels."""
    begins = np.arange(count)[:, None]
    return Rule(((begins + 0.5 * (_NODES + 1.0)) / count).ravel(), np.tile(0.5 * _WEIGHTS / count, count))


SMOOTH = _panels(1)
"""For forces that change little within an interval."""

STEEP = _panels(8)
"""For forces with a kink or a step: the velocity runs through a friction's width within a small part of an interval."""

_CHANGE = 1e-4  # of a scaled rate, for its derivative


@cache
def _matrices(axes: int) -> tuple[sp.Matrix, sp.Matrix, tuple[str, ...]]:
    _, model = model_for(axes)
    m, n = model.system_matrices()
    return m, n, tuple(constant.name for constant in model.flow_constants)


def field(axes: int, constants: Mapping[str, float]) -> tuple[Array, Array]:
    """M (states, states) and N (states, axes) of ṡ = M s + N u, by scaled constants of the model."""
    m, n, names = _matrices(axes)
    _, model = model_for(axes)
    values = {
        constant.symbol: constants.get(name, 0.0) for constant, name in zip(model.flow_constants, names, strict=True)
    }
    return np.array(m.subs(values), dtype=float), np.array(n.subs(values), dtype=float)


def spread_out(pushed: Array, step: float, matrix: Array, rule: Rule) -> Array:
    """What forces (n, nodes, axes) at the nodes of n intervals make of the state at their ends (n, states)."""
    axes = pushed.shape[2]
    shares = zip(rule.nodes, rule.weights, strict=True)
    response = np.array([weight * step * expm(matrix * step * (1.0 - node)) for node, weight in shares])
    velocities = response[:, :, 1::2][:, :, :axes]
    flat = velocities.transpose(0, 2, 1).reshape(-1, len(matrix))
    return np.asarray(pushed.reshape(len(pushed), -1) @ flat)


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
    def transition(self) -> Array:
        """exp(M h) at the mean rate."""
        return np.asarray(expm(self.continuous[0] * self.step))

    @cached_property
    def by_rate(self) -> Array:
        """Its derivative by the rate; zeros for a single axis."""
        if self.axes == 1:
            return np.zeros((2, 2))
        ends = [
            expm(field(2, {**self.constants, "rate": self.mean_rate + change})[0] * self.step)
            for change in (_CHANGE, -_CHANGE)
        ]
        return np.asarray((ends[0] - ends[1]) / (2.0 * _CHANGE))

    @cached_property
    def turning(self) -> Array:
        """Rate less its mean (n,)."""
        return np.asarray(self.rate - self.mean_rate)

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
        # A change of the rate speaks of the velocities, not of the momenta: the Euler force (see `Constant.jump`).
        return total

    def drive_at(self, rule: Rule) -> Array:
        """(n, nodes, axes)."""
        powers = rule.nodes[:, None] ** np.arange(self.drive.shape[2])
        return np.asarray(np.einsum("nap,jp->nja", self.drive, powers))

    def pushed(self, force: Array, rule: Rule) -> Array:
        """What a force (n, nodes, axes) adds to the state over each interval, (n, states)."""
        return spread_out(force, self.step, self.continuous[0], rule)


def jumps(motion: Array, rate: Array) -> Array:
    """What changes of the rate (n,) add to the state (n, 4) of a two-axis gyro: the Euler force as an impulse."""
    change = np.diff(rate, prepend=rate[:1])
    added = np.zeros((len(rate), 4))
    added[:, 1] = motion[:, 2] * change
    added[:, 3] = -motion[:, 0] * change
    return added


def scaled_constants(observer: Observer, constants: Mapping[str, float]) -> dict[str, float]:
    """SI to scaled, by name."""
    return {name: value / float(observer.factors[observer.names.index(name)]) for name, value in constants.items()}
