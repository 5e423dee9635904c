"""The motion between the samples, and what terms of a library are along it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import sympy as sp
from scipy.linalg import expm

from estimator.kernel.compiled import compiled
from estimator.missing_force.library import Term
from estimator.missing_force.linear import NODES, Linear
from estimator.scaling import Array


@dataclass(frozen=True, eq=False)
class Points:
    """Series by symbol, scaled: at the nodes of the interval that ends at each sample (n, nodes), and at samples (n,);
    motion (n, states).
    """

    linear: Linear
    motion: Array
    at_nodes: Mapping[str, Array]
    at_samples: Mapping[str, Array]

    def evaluated(self, term: Term) -> tuple[Array, Array]:
        """What the columns of a term add to the state over each interval (n, states, columns), and to what is sensed
        (n, axes, columns).
        """
        n, axes, size = len(self.linear.sense), self.linear.axes, self.linear.states
        pushed, sensed = np.zeros((n, size, len(term.columns))), np.zeros((n, axes, len(term.columns)))
        for column, pair in enumerate(term.columns):
            if term.sense:
                values = self._values(term, pair[:axes], self.at_samples, (n,))
                sensed[:, :, column] = np.stack(values, axis=1)
            elif term.series == "du":
                axis = 0 if pair[0] != 0 else 1
                pushed[:, :, column] = self._late[:, axis : axis + 1] * self._impulse[None, :, axis]
            else:
                values = self._values(term, pair[:axes], self.at_nodes, (n, len(NODES)))
                pushed[:, :, column] = self.linear.pushed(np.stack(values, axis=2))
        return pushed, sensed

    def force(self, term: Term, coefficients: Sequence[float]) -> Array:
        """The force (n, axes) of a term at the samples; zeros where it is sensed and does not push."""
        n, axes = len(self.linear.sense), self.linear.axes
        total = np.zeros((n, axes))
        if term.sense:
            return total
        for value, pair in zip(coefficients, term.columns, strict=True):
            total += value * np.stack(self._values(term, pair[:axes], self.at_samples, (n,)), axis=1)
        return total

    def _values(
        self, term: Term, pair: Sequence[sp.Expr], series: Mapping[str, Array], shape: tuple[int, ...]
    ) -> list[Array]:
        found = []
        for expression in pair:
            names = sorted(str(symbol) for symbol in expression.free_symbols)
            own = [self._series(term, name, series) for name in names]
            function = sp.lambdify([sp.Symbol(name) for name in names], _plain(expression), "numpy", cse=True)
            found.append(np.broadcast_to(np.asarray(function(*own), dtype=float), shape))
        return found

    def _series(self, term: Term, name: str, series: Mapping[str, Array]) -> Array:
        if term.series == "z":
            assert term.threshold is not None
            q = self.at_nodes[name[-1]]
            flat = np.ascontiguousarray(q.ravel())
            slipped = _slip(flat, term.threshold[1], term.rounded).reshape(q.shape)
            return slipped if series is self.at_nodes else np.asarray(slipped[:, -1])
        return series[name]

    @cached_property
    def _late(self) -> Array:
        """The drive of the interval before less that of this one (n, axes)."""
        value = self.linear.drive[:, :, 0]
        return np.concatenate([np.zeros((1, value.shape[1])), value[:-1] - value[1:]])

    @cached_property
    def _impulse(self) -> Array:
        """What an impulse at the begin of an interval makes of the state at its end (states, axes)."""
        m, n = self.linear.continuous
        return np.asarray(expm(m * self.linear.step) @ n)


def _plain(expression: sp.Expr) -> sp.Expr:
    """With symbols that have no assumptions."""
    return expression.subs({symbol: sp.Symbol(symbol.name) for symbol in expression.free_symbols})


def points_of(linear: Linear, motion: Array, force: Array, temperature: Array | None, first: int = 0) -> Points:
    """Along a motion (n, states) with the force (n, axes) that is missing; time counts from `first` samples before."""
    n, axes = len(motion), linear.axes
    m, b = linear.continuous
    h = linear.step
    slope = motion @ m.T
    degree = linear.drive.shape[2]
    begin, end = linear.drive[:, :, 0], linear.drive @ np.ones(degree)
    ends = []
    for drive, rows in ((begin, slice(None, -1)), (end, slice(1, None))):
        own = slope[rows] + drive[1:] @ b.T
        own[:, 1::2] += force[rows]
        ends.append(own)
    nodes = np.empty((n, len(NODES), 2 * axes))
    nodes[0] = motion[0]
    for index, share in enumerate(NODES):
        nodes[1:, index] = _hermite(motion[:-1], motion[1:], h * ends[0], h * ends[1], share)
    driven = linear.drive_at_nodes()
    time: Array = np.asarray((first + np.arange(n)) * h, dtype=float)
    at_nodes: dict[str, Array] = {}
    at_samples: dict[str, Array] = {}
    moved = np.cumsum(motion[:, ::2] - np.mean(motion[:, ::2], axis=0), axis=0) * h
    slow = moved - _mean_over(moved, round(4.0 * np.pi / h))
    for axis in range(axes):
        name = "xy"[axis]
        for key, column in ((name, 2 * axis), (f"v{name}", 2 * axis + 1)):
            at_nodes[key], at_samples[key] = nodes[:, :, column], motion[:, column]
        at_nodes[f"u{name}"], at_samples[f"u{name}"] = driven[:, :, axis], end[:, axis]
        at_samples[f"iq{name}"] = slow[:, axis]
        at_samples[f"du{name}"] = np.asarray(np.diff(end[:, axis], prepend=end[:1, axis]) / h)
    at_nodes["t"], at_samples["t"] = time[:, None] + (NODES - 1.0) * h, time
    if temperature is not None:
        warm = np.nan_to_num(temperature)
        at_samples["temperature"] = warm
        at_nodes["temperature"] = np.repeat(warm[:, None], len(NODES), axis=1)
    return Points(linear, motion, at_nodes, at_samples)


def _hermite(a: Array, b: Array, da: Array, db: Array, share: float) -> Array:
    """Cubic between two values with their slopes over the interval."""
    f, g = share, 1.0 - share
    return np.asarray(a * g * g * (1 + 2 * f) + b * f * f * (1 + 2 * g) + da * f * g * g - db * f * f * g)


def _mean_over(series: Array, rows: int) -> Array:
    """Running mean (n, axes) over so many rows."""
    rows = max(min(rows, len(series)), 1)
    total = np.concatenate([np.zeros((1, series.shape[1])), np.cumsum(series, axis=0)])
    index = np.arange(len(series))
    low, high = np.maximum(index - rows // 2, 0), np.minimum(index + (rows + 1) // 2, len(series))
    return np.asarray((total[high] - total[low]) / (high - low)[:, None])


@compiled
def _slip(q, reach, rounded):  # type: ignore[no-untyped-def]
    """A spring that slips: all at once at its reach (Prandtl), or more and more towards it and, unloaded, not at all
    (Bouc and Wen, exponent 1).
    """
    out = np.zeros(len(q))
    z = 0.0
    for k in range(1, len(q)):
        moved = q[k] - q[k - 1]
        if not rounded:
            z = min(max(z + moved, -reach), reach)
        elif moved * z < 0.0:
            rest = moved + z
            z = rest if rest * moved <= 0.0 else np.sign(rest) * reach * (1.0 - np.exp(-abs(rest) / reach))
        elif moved != 0.0:
            side = np.sign(moved)
            z = side * (reach - (reach - abs(z)) * np.exp(-abs(moved) / reach))
        out[k] = z
    return out
