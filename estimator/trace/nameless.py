"""The nameless rival: an unknown force of free spectrum on each axis, in place of an effect with a name.

An observer that carries such a force sees what the bench's observer sees, and predicts each innovation from those
before: the sample is a triangular function of the innovations, so that their likelihood is the record's.  Their
predictor is what the force leaves free.  It is an ARMA model of all axes together, whose moving-average roots stand
where the spectrum asks for them; with those given, the largest likelihood is a least-squares fit (Wahlberg & Mäkilä,
Automatica 32(5), 1996: approximation by Laguerre and Kautz functions).  Order and roots are paid for by Schwarz.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from estimator.scaling import Array
from estimator.side_by_side import side_by_side, together
from estimator.thresholds import THRESHOLDS
from estimator.trace.criterion import TIE, schwarz
from estimator.trace.dispersion import dispersed

_SET = THRESHOLDS.nameless
_RIDGE = float(np.sqrt(np.finfo(float).eps))
"""Of a regressor's power, added to it: two roots on one another would be fitted to rounding."""


@dataclass(frozen=True)
class Nameless:
    """A predictor of a series (n, axes) from its past.

    order: samples before that enter as they are; roots: of the moving average, in the unit circle; weights (regressors,
    axes); covariance (axes, axes) of what is not predicted; numbers: how many were fitted, its roots included.
    """

    order: int
    roots: tuple[complex, ...]
    weights: Array
    covariance: Array
    numbers: int

    def unpredicted(self, series: Array) -> Array:
        """What it does not predict of a series (n, axes), whose lost samples are NaN and stay so."""
        filled, left = np.nan_to_num(series), series.copy()
        axes = series.shape[1]
        for lag in range(1, self.order + 1):  # one by one: all regressors of a long record together fill the memory
            left[lag:] -= filled[:-lag] @ self.weights[(lag - 1) * axes : lag * axes]
        if self.roots:
            left -= regressors(filled, 0, self.roots) @ self.weights[self.order * axes :]
        return left

    def terms(self, left: Array) -> Array:
        """Twice the log-likelihood of each row (n,), but for a constant, by what was not predicted of it (n, axes)."""
        weighed = left @ np.linalg.inv(self.covariance)
        return np.asarray(-np.sum(weighed * left, axis=1) - float(np.linalg.slogdet(self.covariance)[1]))


@dataclass(frozen=True, eq=False)
class Innovations:
    """An observer's innovations (n, axes) V over a record, NaN where a sample is lost, their predicted deviations, and
    the rows of the part that was fitted.
    """

    innovation: Array
    deviation: Array
    fitted: slice
    _found: list[Nameless] = field(default_factory=list, repr=False)

    @cached_property
    def series(self) -> Array:
        """Over their deviations; NaN what is no number."""
        with np.errstate(all="ignore"):
            series = self.innovation / self.deviation
        return np.where(np.isfinite(series), series, np.nan)

    @cached_property
    def level(self) -> Nameless:
        """Without a force."""
        return level(self.series, self.fitted)

    @property
    def nameless(self) -> Nameless:
        """With one."""
        if not self._found:  # `cached_property` of Python 3.11 has one lock for all: two threads, one after another
            self._found.append(nameless(self.series, self.fitted))
        return self._found[0]


def level(series: Array, rows: slice) -> Nameless:
    """No force, and a noise as large as the series (n, axes) is in these rows."""
    return _Equations.of(_last(series, rows)).solved()


def nameless(series: Array, rows: slice) -> Nameless:
    """The predictor with the largest likelihood of these rows of a series (n, axes), less its price."""
    fitted = _last(series, rows)
    best = _Equations.of(fitted)
    orders = _orders(len(fitted) / (_SET.repeats * fitted.shape[1]))
    if orders:
        longest = best.with_order(orders[-1])
        best = max((best, *(longest.up_to(order) for order in orders)), key=lambda one: one.standing)
    for _ in range(_SET.roots):
        frequency = _loudest(best.solved().unpredicted(fitted))
        trials = side_by_side([partial(best.with_root, root) for root in _roots_at(frequency, len(fitted))])
        trial = max(trials, key=lambda one: one.standing)
        if not trial.standing > best.standing:
            break
        best = trial
    return best.solved()


@dataclass(frozen=True)
class Contest:
    """What the part held out says of effects with a name and of the force without: gains of twice its log-likelihood
    over the model as it was, each with noises as large as the part that was fitted shows them.

    named: with the effects; nameless: with the force in their place; both: with the effects, and the force for what
    they leave; samples: how many numbers these are of; dispersions: by how much the lead of both over nameless, and of
    both over named, is less sure than white innovations would make it.
    """

    named: float
    nameless: float
    both: float
    samples: int
    dispersions: tuple[float, float] = (1.0, 1.0)

    @property
    def lead(self) -> float:
        """By how much the effects are ahead of the force, which may have what they leave."""
        return self.both - self.nameless

    @property
    def bound(self) -> float:
        """A lead that is worth odds of 20 to 1, as between any two accounts of a record."""
        return TIE * max(self.dispersions[0], 1.0)

    @property
    def left(self) -> float:
        """What the force gains beside the effects."""
        return self.both - self.named


def contest(before: Innovations, after: Innovations, split: int) -> Contest:
    """On the rows from `split` on: the model as it was, and the one with effects."""
    rows = np.all(np.isfinite(before.innovation[split:]), axis=1)
    plain, _ = _scored(before.level, before, split, rows)
    together(lambda: before.nameless, lambda: after.nameless)
    reached = {
        "named": _scored(after.level, after, split, rows),
        "nameless": _scored(before.nameless, before, split, rows),
        "both": _scored(after.nameless, after, split, rows),
    }
    both = reached["both"][1]
    return Contest(
        **{what: likelihood - plain for what, (likelihood, _) in reached.items()},
        samples=both.size,
        dispersions=(dispersed(both, reached["nameless"][1]), dispersed(both, reached["named"][1])),
    )


def _scored(model: Nameless, one: Innovations, split: int, rows: NDArray[np.bool_]) -> tuple[float, Array]:
    """Twice the log-likelihood of `rows` of those from `split` on, −∞ where it is no number; and what is not predicted
    there over its deviation (rows, axes).
    """
    later = one.deviation[split:][rows]
    left = model.unpredicted(one.series)[split:][rows]
    with np.errstate(all="ignore"):
        whole = float(np.sum(model.terms(left)) - 2.0 * np.sum(np.log(later)))
        normalised = left @ np.linalg.inv(np.linalg.cholesky(model.covariance)).T
    return whole if np.isfinite(whole) else -np.inf, normalised


def regressors(series: Array, order: int, roots: tuple[complex, ...]) -> Array:
    """The past of a series (n, axes): its last samples, and what each root remembers of it (n, regressors)."""
    from scipy.signal import lfilter  # loads scipy.stats as well, which a run does without

    columns = []
    for lag in range(1, order + 1):
        late = np.zeros_like(series)
        late[lag:] = series[:-lag]
        columns.append(late)
    for root in roots:
        remembered = lfilter([0.0, np.sqrt(1.0 - abs(root) ** 2)], [1.0, -root], series, axis=0)
        columns.append(np.real(remembered))
        if root.imag:
            columns.append(np.imag(remembered))
    return np.concatenate(columns, axis=1) if columns else np.zeros((len(series), 0))


@dataclass(frozen=True, eq=False)
class _Equations:
    """Normal equations of a predictor, grown by what it is given more.

    series (n, axes) without gaps; there (n,): rows that count; past: regressors (rows, …), block by block, now (rows,
    axes); normal, cross and power: their products.
    """

    series: Array
    there: NDArray[np.bool_]
    order: int
    roots: tuple[complex, ...]
    past: tuple[Array, ...]
    now: Array
    normal: Array
    cross: Array
    power: Array

    @classmethod
    def of(cls, fitted: Array) -> "_Equations":
        """Without a regressor."""
        there = np.all(np.isfinite(fitted), axis=1)
        now = fitted[there]
        axes = now.shape[1]
        power = now.T @ now
        nothing = np.zeros((0, 0)), np.zeros((0, axes))
        return cls(np.nan_to_num(fitted), there, 0, (), (), now, *nothing, power)

    def with_order(self, order: int) -> "_Equations":
        """With so many samples before, where there was nothing."""
        return replace(self._with(regressors(self.series, order, ())), order=order)

    def up_to(self, order: int) -> "_Equations":
        """Of the samples before so many only."""
        own = slice(0, order * self.now.shape[1])
        past = (self.past[0][:, own],)
        return replace(self, order=order, past=past, normal=self.normal[own, own], cross=self.cross[own])

    def with_root(self, root: complex) -> "_Equations":
        """With one root more."""
        return replace(self._with(regressors(self.series, 0, (root,))), roots=(*self.roots, root))

    def _with(self, columns: Array) -> "_Equations":
        new = columns[self.there]
        own = new.T @ new
        beside = np.concatenate([np.zeros((0, new.shape[1])), *(block.T @ new for block in self.past)])
        return replace(
            self,
            past=(*self.past, new),
            normal=np.block([[self.normal, beside], [beside.T, own]]),
            cross=np.concatenate([self.cross, new.T @ self.now]),
        )

    @cached_property
    def weights(self) -> Array:
        """Of the regressors, by least squares."""
        if not len(self.normal):
            return np.zeros_like(self.cross)
        size = np.sqrt(np.maximum(np.diagonal(self.normal), np.finfo(float).tiny))
        scaled = self.normal / np.outer(size, size) + _RIDGE * np.eye(len(size))
        return np.asarray(np.linalg.solve(scaled, self.cross / size[:, None]) / size[:, None])

    @cached_property
    def covariance(self) -> Array:
        """Of what they do not predict."""
        w = self.weights
        left = self.power - self.cross.T @ w - w.T @ self.cross + w.T @ self.normal @ w
        return np.asarray(left / max(len(self.now), 1) + np.finfo(float).tiny * np.eye(len(left)))

    @cached_property
    def numbers(self) -> int:
        """How many are fitted."""
        roots = sum(1 if root.imag == 0.0 else 2 for root in self.roots)
        axes = len(self.power)
        return len(self.cross) * axes + roots + axes * (axes + 1) // 2

    @cached_property
    def standing(self) -> float:
        """Twice the log-likelihood less the price."""
        samples = max(len(self.now), 2)
        return -samples * float(np.linalg.slogdet(self.covariance)[1]) - schwarz(self.numbers, samples)

    def solved(self) -> Nameless:
        """The predictor."""
        return Nameless(self.order, self.roots, self.weights, self.covariance, self.numbers)


def _last(series: Array, rows: slice) -> Array:
    """As many of these rows as are used: the same for everyone who is compared."""
    return series[max(rows.start, rows.stop - _SET.samples) : rows.stop]


def _orders(most: float) -> list[int]:
    """Each twice the last: a gain that stops is seen all the same."""
    found, order = [], 1
    while order <= min(_SET.order, most):
        found.append(order)
        order *= 2
    return found


def _loudest(left: Array) -> float:
    """The frequency, rad per sample, where what is left departs most from white: by how much a band of its own level
    would raise Whittle's likelihood, for bands of every width.
    """
    filled = np.nan_to_num(left)
    power = np.abs(np.fft.rfft(filled, axis=0)) ** 2
    power[0] *= 2.0
    shape: NDArray[np.float64] = np.mean(power / np.maximum(np.mean(power, axis=0), np.finfo(float).tiny), axis=1)
    total = np.concatenate([[0.0], np.cumsum(shape)])
    best, at = -np.inf, 0.0
    width = 1
    while width <= len(shape) // 4:
        mean = np.maximum((total[width:] - total[:-width]) / width, np.finfo(float).tiny)
        gain = width * (mean - 1.0 - np.log(mean))
        here = int(np.argmax(gain))
        if gain[here] > best:
            best, at = float(gain[here]), here + (width - 1) / 2.0
        width *= 2
    return float(np.pi * at / max(len(shape) - 1, 1))


def _roots_at(frequency: float, samples: int) -> list[complex]:
    """Roots there with every memory that the record can show; also on the real axis, where the memory is shorter than a
    cycle.
    """
    found: list[complex] = []
    memory = _SET.shortest
    while memory * _SET.repeats <= samples:
        radius = float(np.exp(-1.0 / memory))
        slow = frequency * memory < 1.0
        found.append(complex(radius, 0.0) if slow else complex(radius * np.exp(1j * frequency)))
        memory *= 2.0
    return found or [complex(np.exp(-1.0 / _SET.shortest), 0.0)]
