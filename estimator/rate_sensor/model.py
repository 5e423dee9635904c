"""The chain from rate to volts with the effects it carries, and its fit to some rows of a record."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from estimator.rate_sensor.declaration import Effect, Range, Stage
from estimator.rate_sensor.record import SensorRecord
from estimator.scaling import Array

Rows = NDArray[np.bool_]
_STEP = 1e-6  # relative step of the numerical Jacobian
_T95 = 1.96
_MOST = 100  # evaluations of a fit
_BLIND = 1e-9  # of the largest singular value


@dataclass(frozen=True)
class Chain:
    """V = V0 + S Ω with effects; its parameters are [V0, S, coefficients of each effect in turn]."""

    effects: tuple[Effect, ...]
    record: SensorRecord
    declared: Range

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return ("V0", "S", *(c.name for effect in self.effects for c in effect.coefficients))

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the parameters, SI but for the output's own."""
        units = ("V", "V·s/rad", *(c.unit for effect in self.effects for c in effect.coefficients))
        return tuple(unit.replace("V", self.declared.unit) for unit in units)

    @property
    def scales(self) -> Array:
        """Typical sizes of the parameters, for the least squares."""
        base = [self.declared.volts, self.declared.volts / self.declared.rate]
        for effect in self.effects:
            for (low, high), start in zip(
                effect.bounds(self.record, self.declared),
                effect.starts(self.record, self.declared)[0],
                strict=True,
            ):
                base.append(abs(start) if start else 0.1 * (high - low))
        return np.array(base)

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the parameters; V0 and S are free."""
        pairs = [(-np.inf, np.inf)] * 2
        for effect in self.effects:
            pairs += effect.bounds(self.record, self.declared)
        low, high = np.array(pairs).T
        return low, high

    def volts(self, parameters: Array) -> Array:
        """Output (n,) V over the whole record."""
        v0, s = parameters[:2]
        given = self._coefficients(parameters)
        rate = self.record.rate
        for effect, c in sorted(given, key=lambda pair: pair[0].stage):
            if effect.stage in (Stage.REFERENCE, Stage.RATE):
                rate = effect.act(rate, c, self.record, self.declared)
        curve = rate + self._sum(Stage.CHARACTERISTIC, rate, given)
        volts = v0 + s * curve + self._sum(Stage.SURROUNDINGS, rate, given)
        for effect, c in given:
            if effect.stage is Stage.LIMIT:
                volts = effect.act(volts, c, self.record, self.declared)
        return np.asarray(volts)

    def _coefficients(self, parameters: Array) -> list[tuple[Effect, Array]]:
        given, first = [], 2
        for effect in self.effects:
            given.append((effect, parameters[first : first + len(effect.coefficients)]))
            first += len(effect.coefficients)
        return given

    def _sum(self, stage: Stage, signal: Array, given: Sequence[tuple[Effect, Array]]) -> Array:
        total = np.zeros(len(self.record))
        for effect, c in given:
            if effect.stage is stage:
                total += effect.act(signal, c, self.record, self.declared)
        return total

    def transients(self, parameters: Array) -> Array:
        """What the output (n, k) may hold beside `volts` of a start that was not at rest, each of unknown size."""
        columns = [effect.transient(c, self.record) for effect, c in self._coefficients(parameters) if effect.transient]
        return np.concatenate([np.zeros((len(self.record), 0)), *columns], axis=1)

    def jacobian(self, parameters: Array) -> Array:
        """Derivative of `volts` by the parameters (n, parameters), by central differences."""
        scales = self.scales
        columns = []
        for i, scale in enumerate(scales):
            nudge = np.zeros(len(scales))
            nudge[i] = 10.0 * _STEP * scale
            columns.append((self.volts(parameters + nudge) - self.volts(parameters - nudge)) / (2.0 * nudge[i]))
        return np.array(columns).T


@dataclass(frozen=True)
class SensorFit:
    """A chain fitted to some rows: parameters, residual (n,) V of the whole record, sum of squares of the rows."""

    chain: Chain
    parameters: Array
    residual: Array
    cost: float

    @property
    def unknowns(self) -> int:
        """How many numbers were fitted: the parameters, and the start of each response."""
        return len(self.parameters) + int(self.chain.transients(self.parameters).shape[1])

    def rms(self, rows: Rows) -> float:
        """Rms residual of the rows, V."""
        return float(np.sqrt(np.mean(self.residual[rows] ** 2)))

    def half_widths(self, rows: Rows, effective: float) -> Array:
        """Half-widths of the 95 % intervals from the Jacobian, residuals counted as `effective` independent ones."""
        jacobian = self.chain.jacobian(self.parameters)[rows] * self.chain.scales
        starts = self.chain.transients(self.parameters)[rows]
        jacobian = jacobian - starts @ _sizes(starts, jacobian)
        freedom = max(effective - self.unknowns, 1.0)
        variance = self.cost / int(np.sum(rows)) * effective / freedom
        covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance * int(np.sum(rows)) / effective
        return np.asarray(_T95 * np.sqrt(np.diagonal(covariance)) * self.chain.scales)


def straight_line(record: SensorRecord, declared: Range, rows: Rows) -> SensorFit:
    """The base model, fitted to the rows within the declared range: beyond it nobody promised a line."""
    within = rows & (np.abs(record.rate) <= declared.rate * (1.0 + 1e-9))
    matrix = np.column_stack([np.ones(len(record)), record.rate])
    if np.linalg.matrix_rank(matrix[within]) < 2:
        within = rows
    parameters = np.asarray(np.linalg.lstsq(matrix[within], record.voltage[within], rcond=None)[0], dtype=np.float64)
    residual = record.voltage - matrix @ parameters
    return SensorFit(Chain((), record, declared), parameters, residual, float(np.sum(residual[rows] ** 2)))


def fit(chain: Chain, rows: Rows, starts: Sequence[Array]) -> SensorFit:
    """Least squares of the chain over the rows from the best of several starts."""
    low, high = chain.bounds()
    margin = 1e-9 * chain.scales

    def left(parameters: Array) -> Array:
        off = chain.record.voltage - chain.volts(parameters)
        starts = chain.transients(parameters)
        return np.asarray(off - starts @ _sizes(starts[rows], off[rows]))

    def residual(parameters: Array) -> Array:
        return np.asarray(-left(parameters)[rows])

    best = None
    for start in starts:
        inside = np.clip(start, low + margin, high - margin)
        solution = least_squares(residual, inside, bounds=(low, high), x_scale=chain.scales, max_nfev=_MOST, ftol=1e-9)
        if best is None or solution.cost < best.cost:
            best = solution
    assert best is not None  # every effect has a start
    parameters = np.asarray(best.x)
    return SensorFit(chain, parameters, left(parameters), 2.0 * float(best.cost))


def _sizes(starts: Array, off: Array) -> Array:
    """Of transients (m, k), as they take up most of `off` (m, …)."""
    if not starts.shape[1]:
        return np.zeros((0, *off.shape[1:]))
    return np.asarray(np.linalg.lstsq(starts, off, rcond=_BLIND)[0])
