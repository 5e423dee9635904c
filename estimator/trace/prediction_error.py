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
    held = _Held(problem, model, told)
    begin, known = held.begin, np.diag(held.known)
    residual, slopes = held.residual(begin), held.slopes(begin)
    if unless_right and _is_top(np.concatenate([slopes, known]), np.concatenate([residual, held.beside(begin)])):
        return model
    worth = max(worth_of(residual), 1.0)
    found = least_squares(
        lambda values: np.concatenate([held.residual(values), worth * held.beside(values)]),
        begin,
        jac=lambda values: np.concatenate([held.slopes(values), worth * known]),
        x_scale="jac",
        ftol=0.1 / residual.size,  # of a sum of squares that is about as large as there are samples
        xtol=None,
        gtol=None,
        max_nfev=10,
        bounds=(held.least, np.inf),
    )
    fitted, estimates = held.run(found.x)
    information = (worth * held.known) ** 2
    spread = covariance_of(found.jac[: residual.size], held.over_noise(estimates), information, worth)
    # Of directions that neither the record nor the bench file tells, the filter is as sure as it began.
    _, sizes, directions = np.linalg.svd(found.jac, full_matrices=False)
    blind = directions[sizes <= THRESHOLDS.scan.blind * sizes[0]]
    fitted.assume(held.names, (spread + blind.T @ blind) * np.outer(held.unit, held.unit))
    return replace(model, settings=fitted.settings, observer=fitted, estimates=estimates)


class _Held:
    """A model over its record with constants and coefficients held at values (k,), in units of how sure its filter is.

    names, unit (k,): of what is held, and that in SI; begin: what the filter came to; least: the smallest values that
    they may have; known (k,): one over how surely each is known beforehand, 0 where nothing is.
    """

    def __init__(self, problem: Problem, model: Fitted, told: Callable[[int, int], None]) -> None:
        observer = model.observer
        given = _known_beforehand(problem, observer)
        self.names = _sought(observer)
        rows = [observer.estimated.index(name) for name in self.names]
        covariance = observer.covariance[np.ix_(rows, rows)]
        self.unit = np.sqrt(np.diagonal(covariance))
        # A hundredth of what noise tells, in directions that it tells apart: some are known together only, and one may
        # hang on the others, which rounding makes less than nothing.
        sizes, directions = np.linalg.eigh(covariance / np.outer(self.unit, self.unit))
        self._steps = 0.01 * directions * np.sqrt(np.maximum(sizes, 1e-9))
        self.begin, self.least = (
            values[[observer.names.index(name) for name in self.names]] / self.unit
            for values in (observer.state, least_values(observer))
        )
        beforehand = [given.get(name, Declared(0.0, np.inf)) for name in self.names]
        deviation = np.array([one.deviation for one in beforehand])
        self.known = self.unit / deviation
        self._level = np.array([one.value for one in beforehand]) / deviation
        self._problem, self._model, self._told, self._passes = problem, model, told, 0
        _, first = self.run(self.begin)
        self._seen = np.isfinite(first.innovation)
        self._weight = 1.0 / first.innovation_deviation[self._seen]
        self._last = self.begin, self.over_noise(first)
        self._slopes = np.full_like(self.begin, np.nan), self._last[1]  # of nowhere yet

    def run(self, values: Array) -> tuple[Observer, Estimates]:
        """The observer behind the record, and what it estimated."""
        problem, model = self._problem, self._model
        named = dict(zip(self.names, (values * self.unit).tolist(), strict=True))
        observer = Observer(problem.device, _at(model.settings, model.observer, named), problem.controller)
        observer.hold(self.names)
        begin_moving(observer, problem.record)
        return observer, run(observer, problem.record)

    def residual(self, values: Array) -> Array:
        """Its innovations (n,) over what was predicted of them where the filter left off, those of lost samples out."""
        if not np.array_equal(values, self._last[0]):
            self._last = values.copy(), self._weighted(values)
        return self._last[1]

    def slopes(self, values: Array) -> Array:
        """Their derivatives (n, k)."""
        if not np.array_equal(values, self._slopes[0]):
            here, before = self.residual(values), self._passes
            self._passes += len(self.names)
            moved = side_by_side(
                [partial(self._weighted, one) for one in values + self._steps.T],
                lambda done: self._told(before + done, self._passes),
            )
            along = np.stack(moved, axis=1) - here[:, None]
            self._slopes = values.copy(), np.linalg.solve(self._steps.T, along.T).T
        return self._slopes[1]

    def beside(self, values: Array) -> Array:
        """How far these are (k,) from what is known beforehand, over how surely."""
        return np.asarray(self.known * values - self._level)

    def _weighted(self, values: Array) -> Array:
        return self.over_noise(self.run(values)[1])

    def over_noise(self, estimates: Estimates) -> Array:
        """What `residual` is, of a run that was made."""
        left: Array = estimates.innovation[self._seen] * self._weight
        # Where the filter diverges, the search is told to come back.
        return np.clip(np.nan_to_num(left, nan=1e6), -1e6, 1e6)


def _is_top(slopes: Array, residual: Array) -> bool:
    """Whether least squares of `residual` (n,) with these slopes (n, k), in units of what a filter takes its estimates
    to be sure of, have their least where it is, nearly, and tell no less.
    """
    rows, sizes, directions = np.linalg.svd(slopes, full_matrices=False)
    seen = sizes > THRESHOLDS.scan.blind * sizes[0]
    spread = directions[seen].T / sizes[seen]
    sure = np.sqrt(np.sum(spread**2, axis=1))
    away = spread @ (rows.T[seen] @ residual)
    return bool(np.all(sure < _SET.surer) and np.all(np.abs(away) <= _SET.off * sure))


def _known_beforehand(problem: Problem, observer: Observer) -> dict[str, Declared]:
    """What is declared of the constants; of what wanes, of which a few samples tell, what a filter begins with."""
    plain = replace(problem.settings, gain=Gain.EKF, effects={})
    spread = scales(observer)
    waning = [c.name for _, effect in observer.effects for c in effect.coefficients if c.wanes]
    return declared(Observer(problem.device, plain, problem.controller)) | {
        name: Declared(0.0, float(spread[observer.names.index(name)])) for name in waning
    }


def _sought(observer: Observer) -> list[str]:
    """Constants but for the rate, which moves, and for offsets; then the coefficients of effects: of all of these the
    ones that are not known exactly.
    """
    stay = {one.name for one in observer.model.constants if one.quantity in (Quantity.OFFSET, Quantity.RATE)}
    sure = np.diagonal(observer.covariance)[observer.states :]
    names = observer.estimated[observer.states :]
    return [name for name, variance in zip(names, sure, strict=True) if name not in stay and variance > 0.0]


def _at(settings: ObserverSettings, observer: Observer, values: Mapping[str, float]) -> ObserverSettings:
    """These settings with constants and coefficients that begin at `values`."""
    effects = {}
    for _, effect in observer.effects:
        own = {c.name.partition(":")[0]: values[c.name] for c in effect.coefficients}
        effects[effect.name] = {**settings.effects[effect.name], **own}
    constants = {name: value for name, value in values.items() if name in observer.model.names}
    return replace(settings, initial={**settings.initial, **constants}, effects=effects)
