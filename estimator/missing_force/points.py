"""The motion between the samples, and what terms of a library are along it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import sympy as sp
from scipy.linalg import expm

from estimator.core.series import behind, slipped
from estimator.missing_force.library import Term
from estimator.missing_force.linear import SMOOTH, STEEP, Linear, Rule
from estimator.missing_force.readings import Readings
from estimator.scaling import Array


@dataclass(frozen=True, eq=False)
class Points:
    """A motion (n, states) and its slope at both ends of each interval (n, 2, states), scaled, with what else a term
    may ask: series at the samples by symbol (n,), and what the readings alone say.
    """

    linear: Linear
    motion: Array
    slope: Array
    at_samples: Mapping[str, Array]
    readings: Readings
    _found: dict[tuple[str, int], Array] = field(default_factory=dict)

    def evaluated(self, term: Term) -> tuple[Array, Array]:
        """What the columns of a term add to the state over each interval (n, states, columns), and to what is sensed
        (n, axes, columns).
        """
        n, axes, size = len(self.linear.sense), self.linear.axes, self.linear.states
        pushed, sensed = np.zeros((n, size, len(term.columns))), np.zeros((n, axes, len(term.columns)))
        rule = STEEP if term.steep else SMOOTH
        for column, pair in enumerate(term.columns):
            if term.sense:
                values = self._values(term, pair[:axes], None)
                sensed[:, :, column] = np.stack(values, axis=1)
            elif term.series == "du":
                axis = 0 if pair[0] != 0 else 1
                pushed[:, :, column] = self._late[:, axis : axis + 1] * self._impulse[None, :, axis]
            else:
                values = self._values(term, pair[:axes], rule)
                pushed[:, :, column] = self.linear.pushed(np.stack(values, axis=2), rule)
        return pushed, sensed

    def force(self, term: Term, coefficients: Sequence[float]) -> Array:
        """The force (n, axes) of a term at the samples; zeros where it is sensed and does not push."""
        n, axes = len(self.linear.sense), self.linear.axes
        total = np.zeros((n, axes))
        if term.sense:
            return total
        for value, pair in zip(coefficients, term.columns, strict=True):
            total += value * np.stack(self._values(term, pair[:axes], None), axis=1)
        return total

    def _values(self, term: Term, pair: Sequence[sp.Expr], rule: Rule | None) -> list[Array]:
        """Along each axis: at the nodes of a rule (n, nodes), or at the samples (n,)."""
        n = len(self.linear.sense)
        shape = (n,) if rule is None else (n, len(rule.nodes))
        found = []
        for expression in pair:
            names = sorted(str(symbol) for symbol in expression.free_symbols)
            own = [self._series(term, name, rule) for name in names]
            function = sp.lambdify([sp.Symbol(name) for name in names], _plain(expression), "numpy", cse=True)
            found.append(np.broadcast_to(np.asarray(function(*own), dtype=float), shape))
        return found

    def _series(self, term: Term, name: str, rule: Rule | None) -> Array:
        axis = "xy".find(name[-1])
        if term.series == "z":
            assert term.threshold is not None
            q = self._at(name[-1], SMOOTH)
            flat = np.ascontiguousarray(q.ravel())
            slips = slipped(flat, term.threshold[1], rounded=term.rounded).reshape(q.shape)
            return np.asarray(slips[:, -1]) if rule is None else slips
        if term.series == "slewed":
            assert term.threshold is not None
            shares = np.ones(1) if rule is None else rule.nodes
            left = behind(self.linear.drive[:, axis, 0], term.threshold[1] * self.linear.step, shares)
            return left[:, 0] if rule is None else left
        if term.series == "reading":
            return np.asarray(self.motion[:, 2 * axis] + self.linear.offset[axis])
        if term.series == "lost":
            shown = self.motion[:, 2 * axis] + self.linear.offset[axis]
            return self.readings.taken(axis, shown, self.linear.sense[:, axis])
        if term.series == "levels":
            return self.readings.levels[:, axis]
        return self.at_samples[name] if rule is None else self._at(name, rule)

    def _at(self, name: str, rule: Rule) -> Array:
        """A series at the nodes of a rule (n, nodes)."""
        key = name, len(rule.nodes)
        if key not in self._found:
            self._found[key] = self._between(name, rule)
        return self._found[key]

    def _between(self, name: str, rule: Rule) -> Array:
        h, count = self.linear.step, len(rule.nodes)
        if name == "t":
            return np.asarray(self.at_samples["t"][:, None] + (rule.nodes - 1.0) * h)
        if name == "temperature":
            return np.repeat(self.at_samples["temperature"][:, None], count, axis=1)
        axis = "xy".index(name[-1])
        if name.startswith("u"):
            return np.ascontiguousarray(self.linear.drive_at(rule)[:, :, axis])
        column = 2 * axis + (name[0] == "v")
        series, slope = self.motion[:, column : column + 1], h * self.slope[:, :, column]
        out = np.empty((len(series), count))
        out[0] = series[0]
        out[1:] = _hermite(series[:-1], series[1:], slope[1:, :1], slope[1:, 1:], rule.nodes)
        return out

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


def points_of(
    linear: Linear, motion: Array, force: Array, temperature: Array | None, readings: Readings, first: int = 0
) -> Points:
    """Along a motion (n, states) with the force (n, axes) that is missing; time counts from `first` samples before."""
    n, axes = len(motion), linear.axes
    m, b = linear.continuous
    h = linear.step
    free = motion @ m.T
    begin, end = linear.drive[:, :, 0], linear.drive @ np.ones(linear.drive.shape[2])
    slope = np.zeros((n, 2, 2 * axes))
    for which, (drive, rows) in enumerate(((begin, slice(None, -1)), (end, slice(1, None)))):
        slope[1:, which] = free[rows] + drive[1:] @ b.T
        slope[1:, which, 1::2] += force[rows]
    at_samples: dict[str, Array] = {"t": np.asarray((first + np.arange(n)) * h, dtype=float)}
    moved = np.cumsum(motion[:, ::2] - np.mean(motion[:, ::2], axis=0), axis=0) * h
    slow = moved - _mean_over(moved, round(4.0 * np.pi / h))
    for axis in range(axes):
        name = "xy"[axis]
        at_samples[name], at_samples[f"v{name}"] = motion[:, 2 * axis], motion[:, 2 * axis + 1]
        at_samples[f"u{name}"] = end[:, axis]
        at_samples[f"iq{name}"] = slow[:, axis]
        at_samples[f"du{name}"] = np.asarray(np.diff(end[:, axis], prepend=end[:1, axis]) / h)
    if temperature is not None:
        at_samples["temperature"] = np.nan_to_num(temperature)
    return Points(linear, motion, slope, at_samples, readings)


def _hermite(a: Array, b: Array, da: Array, db: Array, share: Array) -> Array:
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
