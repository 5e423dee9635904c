"""One set of constants under the free runs of several records: least squares over all of them at once.

Motion and offset of each record are its own.  A constant that depends on the covariate is c + s z, with z the covariate
less its mean, over its spread.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.chance import TWO_SIDED
from estimator.errors import ModelError
from estimator.free_stretches import FreeRuns
from estimator.observer import Observer
from estimator.record import Record
from estimator.refinement import Declared, covariance_of, least_squares_beside, least_values, refine, scales, worth_of
from estimator.scaling import Array
from estimator.settings import Gain
from estimator.side_by_side import stop_if_abandoned
from estimator.thresholds import THRESHOLDS
from estimator.trace.determined import declared, unsettled
from estimator.trace.engine import Estimate
from estimator.trace.held_out_error import held_out_error
from estimator.trace.pool.members import Level, Pool, Rows

_SET = THRESHOLDS.pools
_FREE_RUNS = THRESHOLDS.free_runs


@dataclass(frozen=True)
class PooledRun:
    """What was fitted, SI.

    own (records, own names): motion at the first sample and offsets; shared, slopes: values by name, slopes for one
    spread of the covariate; deviation: of these, a slope's under `slope_name`; residual: of each record (n, axes).
    """

    effects: tuple[str, ...]
    observer: Observer
    level: Level
    own: Array
    shared: Mapping[str, float]
    slopes: Mapping[str, float]
    deviation: Mapping[str, float]
    residual: tuple[Array, ...]
    known: Mapping[str, Declared]

    def state(self, record: int, z: float) -> Array:
        """The state vector with which that record is run."""
        return state_of(self.observer, self.own[record], self.constants(z))

    def own_of(self, names: Sequence[str], initial: Mapping[str, float]) -> Array:
        """What each record has by itself of these names (records, names); initial: of those that were not carried."""
        places = {name: place for place, name in enumerate(own_names(self.observer))}
        columns = [self.own[:, places[n]] if n in places else np.full(len(self.own), initial[n]) for n in names]
        return np.stack(columns, axis=1)

    def constants(self, z: float) -> Array:
        """What is shared at a scaled covariate, in the observer's order."""
        return np.array([value + self.slopes.get(name, 0.0) * z for name, value in self.shared.items()])

    def estimate(self, name: str) -> Estimate:
        """A shared value with its 95 % interval, where the covariate is at its mean."""
        half = TWO_SIDED * self.deviation[name]
        return Estimate(self.shared[name], self.shared[name] - half, self.shared[name] + half)

    def slope(self, name: str) -> Estimate:
        """By how much it changes with one of the covariate, in the covariate's own unit."""
        value, half = self.slopes[name], TWO_SIDED * self.deviation[slope_name(name)]
        value, half = value / self.level.spread, half / self.level.spread
        return Estimate(value, value - half, value + half)

    def spread_out(self, rows: Rows) -> Array:
        """The residual at these rows, one after another (k,)."""
        return np.concatenate([r[mask].ravel() for r, mask in zip(self.residual, rows.masks, strict=True)])


def slope_name(name: str) -> str:
    """What a slope is called beside its constant."""
    return f"{name} by covariate"


def observer_of(pool: Pool, effects: Sequence[str]) -> Observer:
    """An observer that carries these effects, as the bench has it else."""
    given = {**pool.begun, **pool.settings.effects}
    carried = {name: dict(given.get(name, {})) for name in effects}
    return Observer(pool.device, replace(pool.settings, gain=Gain.EKF, effects=carried))


def own_names(observer: Observer) -> tuple[str, ...]:
    """What each record has by itself: the motion at its start, the offsets of its channels, and what an effect has of
    where a record begins.
    """
    begins = (c.name for _, effect in observer.effects for c in effect.coefficients if c.own)
    return (*observer.names[: observer.states + len(observer.model.sense_constants)], *begins)


def shared_names(observer: Observer) -> tuple[str, ...]:
    """The others: constants and coefficients of the device."""
    own = own_names(observer)
    return tuple(name for name in observer.names if name not in own)


def state_of(observer: Observer, own: Array, shared: Array) -> Array:
    """The state vector in the observer's order, from values in the order of `own_names` and of `shared_names`."""
    by_name = dict(zip((*own_names(observer), *shared_names(observer)), (*own, *shared), strict=True))
    return np.array([by_name[name] for name in observer.names])


def simulated(run: PooledRun, record: Record, state: Array, *, sensitive: bool = False) -> tuple[Array, Array]:
    """sensed (n, axes), sensitivity (n, axes, all) of one record."""
    made = _runs(run.observer, record).simulate(state, sensitive=sensitive)
    return made.sensed, made.sensitivity


def told(observer: Observer, record: Record) -> NDArray[np.bool_]:
    """Which readings (n, axes) of a record a free run is compared with."""
    return _runs(observer, record).told


def _runs(observer: Observer, record: Record) -> FreeRuns:
    return FreeRuns(observer, record.sense, record.drive, record.step, record.stretches)


def columns_of(own: int, record: int, records: int, z: float, sensitivity: Array, slopes: Sequence[int]) -> Array:
    """Derivatives (rows, unknowns) of rows of one record by [own of every record | shared | slopes], from those by its
    state vector (rows, state); slopes: places of their constants in that.
    """
    rows = len(sensitivity)
    before, after = np.zeros((rows, own * record)), np.zeros((rows, own * (records - record - 1)))
    return np.hstack([before, sensitivity[:, :own], after, sensitivity[:, own:], z * sensitivity[:, slopes]])


def fitted(
    pool: Pool,
    effects: tuple[str, ...],
    slopes: tuple[str, ...],
    start: PooledRun,
    rows: Rows,
    *,
    in_earnest: bool = False,
) -> PooledRun:
    """The pool with these effects and slopes, fitted to these rows from what `start` found; in earnest to the end, else
    with a few free runs, as far as it takes to compare.

    Raises ModelError where the free run of a record leaves all bounds.
    """
    observer = observer_of(pool, effects)
    mine, records, level = own_names(observer), len(pool.members), start.level
    own, names = len(mine), shared_names(observer)
    initial = dict(zip(observer.names, observer.state.tolist(), strict=True))
    begins = start.own_of(mine, initial)
    shared = {name: start.shared.get(name, initial[name]) for name in names}
    begun = {name: start.slopes.get(name, 0.0) for name in slopes}
    free = [name for name in names if name in unsettled(observer)]
    size = scales(observer)
    by_name = dict(zip(observer.names, size.tolist(), strict=True))
    apart, common = [by_name[name] for name in mine], [by_name[name] for name in (*free, *slopes)]
    unknowns = np.concatenate([np.tile(apart, records), common])
    at_free = [observer.names.index(name) for name in free]
    at_own = [observer.names.index(name) for name in mine]
    at_slopes = [observer.names.index(name) for name in slopes]
    z = [level.scaled(member.covariate) for member in pool.members]
    noise = np.array(pool.device.noise)
    chosen = [mask[:, None] & told(observer, m.record) for mask, m in zip(rows.masks, pool.members, strict=True)]
    known = {name: one for name, one in declared(observer).items() if name in free and one.deviation > 0.0}
    bound = dict(zip(observer.names, least_values(observer).tolist(), strict=True))
    lowest = [*np.full(own * records, -np.inf), *(bound[name] for name in free), *np.full(len(slopes), -np.inf)]
    least = np.array(lowest) / unknowns
    places = np.array([own * records + free.index(name) for name in known], dtype=np.int64)
    middle = np.array([one.value for one in known.values()]) / unknowns[places]
    sure = np.array([one.deviation for one in known.values()]) / np.abs(unknowns[places])

    def run_of(theta: Array) -> PooledRun:
        values = theta * unknowns
        now = shared | dict(zip(free, values[own * records :], strict=False))
        tilted = dict(zip(slopes, values[own * records + len(free) :], strict=True))
        each = values[: own * records].reshape(records, own)
        return PooledRun(effects, observer, level, each, now, tilted, {}, (), known)

    cache: dict[bytes, tuple[Array, Array]] = {}

    def rows_of(theta: Array) -> tuple[Array, Array]:
        stop_if_abandoned()
        key = theta.tobytes()
        if key in cache:
            return cache[key]
        cache.clear()
        trial, residuals, jacobians = run_of(theta), [], []
        for number, member in enumerate(pool.members):
            keep = chosen[number]
            weight = np.broadcast_to(1.0 / noise, keep.shape)[keep]
            try:
                sensed, sensitivity = simulated(trial, member.record, trial.state(number, z[number]), sensitive=True)
            except ModelError:
                if theta is origin:
                    raise
                residuals.append(np.full(len(weight), _SET.lost))
                jacobians.append(np.zeros((len(weight), len(theta))))
                continue
            derivative = sensitivity[keep][:, [*at_own, *at_free]]
            tilts = [own + free.index(observer.names[at]) for at in at_slopes]
            residuals.append((sensed - member.record.sense)[keep] * weight)
            columns = columns_of(own, number, records, z[number], derivative, tilts)
            jacobians.append(columns * unknowns * weight[:, None])
        cache[key] = np.concatenate(residuals), np.vstack(jacobians)
        return cache[key]

    origin = np.concatenate([begins.ravel(), [shared[name] for name in free], list(begun.values())]) / unknowns
    rows_of(origin)

    runs, tolerance = (_SET.runs, 1e-9) if in_earnest else (_FREE_RUNS.on_the_way, 1e-5)

    def solved(begin: Array, worth: float) -> Array:
        return least_squares_beside(
            rows_of, begin, places, middle, sure / worth, tolerance=tolerance, runs=runs, least=least
        )

    # Of an effect with a shape that is new, first how large it is, the rest held: until that is known nothing tells
    # where the shape should go.
    new = [effect for _, effect in observer.effects if effect.name not in start.effects]
    sizes = [c for effect in new if any(c.is_shape for c in effect.coefficients) for c in effect.coefficients]
    sizes = [c for c in sizes if not c.is_shape]
    open_to = [own * record + mine.index(c.name) for c in sizes if c.own for record in range(records)]
    open_to += [own * records + free.index(c.name) for c in sizes if not c.own]

    def sized(theta: Array) -> tuple[Array, Array]:
        residuals, whole = rows_of(theta)
        jacobian = np.zeros_like(whole)
        jacobian[:, open_to] = whole[:, open_to]
        return residuals, jacobian

    begin = origin
    if open_to:
        none = places[:0], middle[:0], sure[:0]
        begin = least_squares_beside(sized, origin, *none, tolerance=1e-5, runs=_FREE_RUNS.on_the_way)
    theta = solved(begin, 1.0)
    worth = worth_of(rows_of(theta)[0])
    if worth > 1.0 and in_earnest:
        theta = solved(theta, worth)
    weighted, jacobian = rows_of(theta)
    sureness = np.zeros(len(theta))
    sureness[places] = (max(worth, 1.0) / sure) ** 2
    deviation = np.sqrt(np.diagonal(covariance_of(jacobian, weighted, sureness, max(worth, 1.0)))) * np.abs(unknowns)
    tail = dict(zip([*free, *map(slope_name, slopes)], deviation[own * records :].tolist(), strict=True))
    found = run_of(theta)
    tail = dict.fromkeys(names, 0.0) | tail
    left = tuple(
        member.record.sense - simulated(found, member.record, found.state(number, z[number]))[0]
        for number, member in enumerate(pool.members)
    )
    return replace(found, deviation=tail, residual=left)


def error_on(run: PooledRun, pool: Pool) -> tuple[Array, ...]:
    """Residual (n, axes) of free runs on records that were not fitted; the first quarter of each sets motion and offset
    and is NaN.  Of the offset is known what those of the fitted records were.
    """
    observer, own = run.observer, own_names(run.observer)
    sensed = slice(observer.states, observer.states + len(observer.model.sense_constants))
    offsets, before = own[sensed], run.own[:, sensed]
    known = {
        name: Declared(float(np.mean(column)), max(float(np.std(column)), _SET.offset * pool.device.noise[0]))
        for name, column in zip(offsets, before.T, strict=True)
    }
    errors = []
    for member in pool.members:
        record = member.record
        start = state_of(observer, np.zeros(len(own)), run.constants(run.level.scaled(member.covariate)))
        start[sensed] = np.mean(before, axis=0)
        first = max(_FREE_RUNS.scored_from, len(record) // _SET.beginning)
        begun = record.part(slice(0, min(first, record.stretches[0].stop)))
        free = [name for name in own if name in observer.estimated]
        state = refine(
            observer, begun.sense, begun.drive, start=start, free=free, step=begun.step,
            known={name: one for name, one in known.items() if name in free},
        ).state  # fmt: skip
        errors.append(held_out_error(observer, state, record, first))
    return tuple(errors)
