"""The choice over a pool: effects of the catalogue, and constants and coefficients that depend on the covariate,
compete for what the free runs of all records leave.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from estimator.correlation import effective_samples
from estimator.errors import ModelError
from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS
from estimator.trace.criterion import extended
from estimator.trace.determined import unsettled
from estimator.trace.engine import Estimate, Score, Trial
from estimator.trace.free_run_model import Promise, Promises, each_of
from estimator.trace.pool.fit import PooledRun, columns_of, fitted, observer_of, own_names, simulated, told
from estimator.trace.pool.members import Pool, Rows

_SET = THRESHOLDS.free_runs
_BY = " by "


def dependence(name: str, covariate: str) -> str:
    """What the candidate is called that a constant or a coefficient depends on the covariate."""
    return f"{name}{_BY}{covariate}"


def constant_of(candidate: str) -> str | None:
    """The constant of such a candidate; None for an effect."""
    return candidate.partition(_BY)[0] if _BY in candidate else None


@dataclass(frozen=True)
class PooledModel:
    """`estimator.trace.engine.Model` over a pool: fitted to the rows `choice`, while `later` must agree; progress: told
    how many of a round are fitted.
    """

    pool: Pool
    choice: Rows
    later: Rows
    names: tuple[str, ...]
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None

    def candidates(self, current: PooledRun, barred: Collection[str]) -> list[str]:
        """Effects that are not carried, and what may depend on the covariate of what is."""
        open_names = [name for name in self.names if name not in current.effects]
        if self.pool.covariate is not None:
            free = [name for name in current.shared if name in unsettled(current.observer)]
            open_names += [dependence(name, self.pool.covariate) for name in free if name not in current.slopes]
        return [name for name in open_names if name not in barred]

    def promise(self, current: PooledRun, barred: Collection[str]) -> Promises:
        """At first order, by one free run of each record that carries every effect at zero."""
        return self.promised(current, self.candidates(current, barred))

    def promised(
        self,
        current: PooledRun,
        left: Sequence[str],
        shown: str | None = None,
        held: Mapping[str, float] | None = None,
    ) -> Promises:
        """The same of these candidates; shown: one that is known to be there, however little of it is its own, with the
        values `held` of its coefficients.
        """
        effects = [name for name in left if constant_of(name) is None]
        pool, wide = self.pool, observer_of(self.pool, (*current.effects, *effects))
        mine_at = [wide.names.index(name) for name in own_names(current.observer)]
        own, records = len(mine_at), len(pool.members)
        places = {name: wide.names.index(name) for name in current.shared}
        carried = [places[name] for name in current.shared if name in unsettled(current.observer)]
        tilts = [places[name] for name in current.slopes]
        basis_rows, residual_rows, wide_rows, z_rows, of_rows = [], [], [], [], []
        for number, member in enumerate(pool.members):
            z = current.level.scaled(member.covariate)
            state = wide.state.copy()
            narrow = dict(zip(current.observer.names, current.state(number, z).tolist(), strict=True))
            for name, value in (narrow | dict(held or {})).items():
                state[wide.names.index(name)] = value
            run = PooledRun(
                current.effects, wide, current.level, current.own, {}, {}, {}, (), {}
            )  # only its observer is asked
            sensed, sensitivity = simulated(run, member.record, state, sensitive=True)
            keep = self.choice.masks[number][:, None] & told(run.observer, member.record)
            mine = sensitivity[keep]
            narrowed = mine[:, [*mine_at, *carried]]
            at = [own + carried.index(place) for place in tilts]
            basis_rows.append(columns_of(own, number, records, z, narrowed, at))
            residual_rows.append((member.record.sense - sensed)[keep])
            wide_rows.append(mine)
            z_rows.append(np.full(len(mine), z))
            of_rows.append(np.full(len(mine), number))
        derivative, residual = np.vstack(basis_rows), np.concatenate(residual_rows)
        everything, z_all = np.vstack(wide_rows), np.concatenate(z_rows)
        each = np.concatenate(of_rows)[:, None] == np.arange(records)
        basis = np.linalg.qr(derivative)[0]
        residual = residual - basis @ (basis.T @ residual)
        power, samples = float(residual @ residual), effective_samples(residual)
        found = {}
        for name in left:
            constant = constant_of(name)
            if constant is not None:
                columns = (z_all * everything[:, places[constant]])[:, None]
            else:
                effect = next(effect for _, effect in wide.effects if effect.name == name)
                parts = [everything[:, [wide.names.index(c.name)]] for c in effect.coefficients]
                mixed = zip(effect.coefficients, parts, strict=True)
                columns = np.hstack([part * each if c.own else part for c, part in mixed])
            found[name] = _promise(columns, basis, residual, power, samples, len(left), known=name == shown)
        return found

    def hopeful(
        self, look: Promises, tried: Mapping[str, Trial[PooledRun]], refused: Collection[str], number: int
    ) -> Sequence[str]:
        """Those whose promise outweighs its price, the best few."""
        worth = (name for name, promise in look.items() if promise.gain > promise.price)
        return sorted(worth, key=lambda name: look[name].price - look[name].gain)[: _SET.tried]

    def fit(
        self, current: PooledRun, look: Promises, names: Sequence[str], tried: Mapping[str, Trial[PooledRun]]
    ) -> Mapping[str, PooledRun | str]:
        """Fitted in earnest, from what `current` found."""
        return each_of(names, partial(self._fit, current), self.progress)

    def _fit(self, current: PooledRun, name: str) -> PooledRun | str:
        constant = constant_of(name)
        effects = current.effects if constant is not None else (*current.effects, name)
        slopes = tuple(current.slopes) if constant is None else (*current.slopes, constant)
        try:
            return fitted(self.pool, effects, slopes, current, self.choice)
        except ModelError:
            return "no free run with it stays within bounds"

    def score(self, current: PooledRun, look: Promises, fits: Mapping[str, PooledRun]) -> Mapping[str, Score]:
        """Gains counted in independent samples; the price is that of its promise."""
        gains = {name: gain_of(current, trial, self.choice) for name, trial in fits.items()}
        return {name: Score(gain, gain, look[name].price, look[name].price) for name, gain in gains.items()}

    def coefficients(self, fit: PooledRun) -> Mapping[str, Mapping[str, Estimate]]:
        """Of effects, and slopes under the name of their candidate."""
        return estimates_of(fit, self.pool.covariate)

    def objection(self, current: PooledRun, name: str, trial: Trial[PooledRun]) -> str | None:
        """The rows without a vote must be predicted better as well."""
        if _rms(trial.fit, self.later) >= _rms(current, self.later):
            return "fits two thirds of the samples better and the other third worse"
        return None


def estimates_of(fit: PooledRun, covariate: str | None) -> dict[str, dict[str, Estimate]]:
    """Coefficients of each effect, where the covariate is at its mean, and each slope in the covariate's unit."""
    found = {
        effect.name: {
            c.name: Estimate(one.value, one.low, one.high, c.positive, c.is_shape, effect.gain)
            for c in effect.coefficients
            if not c.own
            for one in [fit.estimate(c.name)]
        }
        for _, effect in fit.observer.effects
    }
    for name in fit.slopes:
        found[dependence(name, covariate or "")] = {name: fit.slope(name)}
    return found


def gain_of(less: PooledRun, more: PooledRun, rows: Rows) -> float:
    """Of twice the log-likelihood, in independent samples."""
    residual = more.spread_out(rows)
    samples = effective_samples(residual[np.isfinite(residual)])
    return samples * 2.0 * math.log(_rms(less, rows) / _rms(more, rows))


def _promise(
    columns: Array, basis: Array, residual: Array, power: float, samples: float, number: int, *, known: bool
) -> Promise:
    rest = columns - basis @ (basis.T @ columns)
    least = 0.0 if known else _SET.visible
    seen = np.linalg.norm(rest, axis=0) > least * np.linalg.norm(columns, axis=0)
    price = extended(columns.shape[1], samples, number)
    if not seen.any():
        return Promise(0.0, price, rest[:, seen])
    q = np.linalg.qr(rest[:, seen] / np.linalg.norm(rest[:, seen], axis=0))[0]
    explained = min(float(np.sum((q.T @ residual) ** 2)), power * (1.0 - 1e-12))
    return Promise(-samples * math.log1p(-explained / power), price, rest[:, seen])


def _rms(fit: PooledRun, rows: Rows) -> float:
    return float(np.sqrt(np.nanmean(fit.spread_out(rows) ** 2)))
