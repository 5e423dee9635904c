"""Constants and coefficients by the likelihood itself, where a filter that estimates them is surer than the record is.

An extended Kalman filter learns the stiffness and damping of an axis that hardly moves from its own estimate of that
motion, which is mostly noise, and a drag beside a damping from an amplitude that its own noise moves: what it comes to
may be far from the truth and have a narrow interval.  Held at given values, constants and coefficients are no states;
the model is linear, but for large motion, and its innovations are exact.  Least squares of the innovations over their
predicted deviations, beside what is declared, is the prediction-error method (Ljung, System Identification, 1999, ch.
7); intervals allow for innovations that are not white.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import lstsq, solve_triangular
from scipy.optimize import least_squares

from estimator.model.declaration import Quantity
from estimator.observer import Estimates, Observer
from estimator.refinement import Declared, covariance_of, least_values, scales, worth_of
from estimator.scaling import Array
from estimator.settings import Gain, ObserverSettings
from estimator.side_by_side import side_by_side
from estimator.thresholds import THRESHOLDS
from estimator.trace.determined import declared
from estimator.trace.fitting import Fitted, run
from estimator.trace.problem import Problem
from estimator.trace.start import begin_moving

_SET = THRESHOLDS.certainty

def by_prediction_error(
    problem: Problem,
    model: Fitted,
    *,
    unless_right: bool = False,
    told: Callable[[int, int], None] = lambda done, total: None,
) -> Fitted:
    """`model`, which was fitted to the record of `problem`, with the constants and coefficients that make its
    innovations least beside what is declared of the constants, and with their covariance.

    The rate, which moves, and the offsets stay states of the filter.  The likelihood stays that of the filter, with
    which others are compared.  With `unless_right`, `model` itself where the likelihood has its top at what the filter
    found, and falls as the filter says: that takes a quarter of the time.  told: of passes that are done, of those that
    are known of.
    """
    observer = model.observer
    given = _known_beforehand(problem, observer)
    names = _sought(observer, given)
    rows = [observer.estimated.index(name) for name in names]
    covariance = observer.covariance[np.ix_(rows, rows)]
    unit = np.sqrt(np.diagonal(covariance))
    # A hundredth of what noise tells, in directions that it tells apart, also where some are known together only.
    correlation = covariance / np.outer(unit, unit) + 1e-9 * np.eye(len(names))  # of which one may hang on the others
    steps = 0.01 * np.linalg.cholesky(correlation)

    def held_at(unknown: Array) -> tuple[Observer, Estimates]:
        values = dict(zip(names, (unknown * unit).tolist(), strict=True))
        trial = Observer(problem.device, _at(model.settings, observer, values), problem.controller)
        trial.hold(names)
        begin_moving(trial, problem.record)
        return trial, run(trial, problem.record)

    begin, least = (
        values[[observer.names.index(name) for name in names]] / unit
        for values in (observer.state, least_values(observer))
    )
    _, first = held_at(begin)
    seen = np.isfinite(first.innovation)
    weight = 1.0 / first.innovation_deviation[seen]
    told_of = [(column, given[name]) for column, name in enumerate(names) if name in given]
    known = np.zeros((len(told_of), len(names)))
    for row, (column, one) in enumerate(told_of):
        known[row, column] = unit[column] / one.deviation
    level = np.array([one.value / one.deviation for _, one in told_of])

    def over_noise(estimates: Estimates) -> Array:
        left: Array = estimates.innovation[seen] * weight
        # Where the filter diverges, the search is told to come back.
        return np.clip(np.nan_to_num(left, nan=1e6), -1e6, 1e6)

    def weighted(unknown: Array) -> Array:
        return over_noise(held_at(unknown)[1])

    passes = [0]

    def jacobian(unknown: Array, here: Array) -> Array:
        before = passes[0]
        passes[0] += len(names)
        moved = side_by_side(
            [partial(weighted, one) for one in unknown + steps.T], lambda done: told(before + done, passes[0])
        )
        along = np.stack(moved, axis=1) - here[:, None]
        return np.asarray(solve_triangular(steps, along.T, lower=True, trans="T").T)

    residual = over_noise(first)
    slopes = jacobian(begin, residual)
    if unless_right and _is_top(np.concatenate([slopes, known]), np.concatenate([residual, known @ begin - level])):
        return model
    worth = max(worth_of(residual), 1.0)
    at = [begin, residual]

    def rows_of(unknown: Array) -> Array:
        at[:] = [unknown, residual if np.array_equal(unknown, begin) else weighted(unknown)]
        return np.concatenate([at[1], worth * (known @ unknown - level)])

    def slopes_of(unknown: Array) -> Array:
        if np.array_equal(unknown, begin):
            return np.concatenate([slopes, worth * known])
        here = at[1] if np.array_equal(unknown, at[0]) else weighted(unknown)
        return np.concatenate([jacobian(unknown, here), worth * known])

    found = least_squares(
        rows_of,
        begin,
        jac=slopes_of,
        x_scale="jac",
        ftol=0.1 / weight.size,  # of a sum of squares that is about as large as there are samples
        xtol=None,
        gtol=None,
        max_nfev=10,
        bounds=(least, np.inf),
    )
    information = worth**2 * np.sum(known**2, axis=0)
    fitted, estimates = held_at(found.x)
    spread = covariance_of(found.jac[: weight.size], over_noise(estimates), information, worth)
    # Of directions that neither the record nor the bench file tells, the filter is as sure as it began.
    _, sizes, directions = np.linalg.svd(found.jac, full_matrices=False)
    blind = directions[sizes <= THRESHOLDS.scan.blind * sizes[0]]
    fitted.assume(names, (spread + blind.T @ blind) * np.outer(unit, unit))
    return replace(model, settings=fitted.settings, observer=fitted, estimates=estimates)


def _is_top(slopes: Array, residual: Array) -> bool:
    """Whether least squares of `residual` (n,) with these slopes (n, k), in units of what a filter takes its estimates
    to be sure of, have their least where it is, nearly, and tell no less.
    """
    _, sizes, directions = np.linalg.svd(slopes, full_matrices=False)
    seen = sizes > THRESHOLDS.scan.blind * sizes[0]
    spread = directions[seen].T / sizes[seen]
    sure = np.sqrt(np.sum(spread**2, axis=1))
    away = lstsq(slopes, -residual, cond=THRESHOLDS.scan.blind)[0]
    return bool(np.all(sure < _SET.surer) and np.all(np.abs(away) <= _SET.off * sure))


def _known_beforehand(problem: Problem, observer: Observer) -> dict[str, Declared]:
    """What is declared of the constants; of what wanes, of which a few samples tell, what a filter begins with."""
    plain = replace(problem.settings, gain=Gain.EKF, effects={})
    spread = scales(observer)
    waning = [c.name for _, effect in observer.effects for c in effect.coefficients if c.wanes]
    return declared(Observer(problem.device, plain, problem.controller)) | {
        name: Declared(0.0, float(spread[observer.names.index(name)])) for name in waning
    }


def _sought(observer: Observer, given: Mapping[str, Declared]) -> list[str]:
    """Constants that neither move nor are known exactly, but for offsets; then the coefficients of effects."""
    stay = {one.name for one in observer.model.constants if one.quantity in (Quantity.OFFSET, Quantity.RATE)}
    stay |= {name for name, one in given.items() if one.deviation == 0.0}
    return [name for name in observer.estimated[observer.states :] if name not in stay]


def _at(settings: ObserverSettings, observer: Observer, values: Mapping[str, float]) -> ObserverSettings:
    """These settings with constants and coefficients that begin at `values`."""
    effects = {}
    for _, effect in observer.effects:
        own = {c.name.partition(":")[0]: values[c.name] for c in effect.coefficients}
        effects[effect.name] = {**settings.effects[effect.name], **own}
    constants = {name: value for name, value in values.items() if name in observer.model.names}
    return replace(settings, initial={**settings.initial, **constants}, effects=effects)
