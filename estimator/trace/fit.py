"""The parameters of a model by maximum likelihood: Gauss and Newton with priors and damping."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimator.chance import TWO_SIDED
from estimator.diagnosis import Interval
from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS
from estimator.trace.likelihood import Evaluation, Layout, Likelihood, Model
from estimator.trace.problem import Effects

PRIOR = THRESHOLDS.criterion.prior
"""Deviations of its prior that a constant may be off."""
PASSES = 12
"""Gauss–Newton converges in three to six; more are a fit that has no top nearby."""
ROUGH = 2
"""Passes between two estimates of the noise."""
GROWTH = 4
"""By how much the next part that is fitted is longer than the one before."""
RISE = 1.0
"""Expected, of the penalised log-likelihood, below which a search does not spend a pass on it."""
SETTLED = 0.02
"""... and below which a fit is at its top: a fifth of a deviation off."""
AS_EXPECTED = 0.25
"""Share of the expected rise, below which a step was too long, and as much short of all, beyond which it was not."""


def beside(information: Array, own: list[int], others: list[int], prior: Array | None = None) -> tuple[Array, Array]:
    """Information (o, o) of parameters `own` where `others` are free, and by how much (m, o) those give way to one of
    each: the Schur complement.  prior (m,): deviations of the others that `information` does not have; without, of what
    it says nothing of nothing gives way.
    """
    free, cross = information[np.ix_(others, others)], information[np.ix_(others, own)]
    if prior is None:
        size = np.sqrt(np.maximum(np.diagonal(free), np.finfo(float).tiny))
        inverse = np.linalg.pinv(free / np.outer(size, size), hermitian=True) / np.outer(size, size)
        taken: Array = np.asarray(inverse @ cross)
    else:
        taken = np.asarray(np.linalg.solve(free + np.diag(prior**-2.0), cross))
    return np.asarray(information[np.ix_(own, own)] - cross.T @ taken), taken


@dataclass(frozen=True)
class FittedModel:
    """A model at its top: layout of its parameters, the pass there, the penalised log-likelihood; damping: that of the
    next step.
    """

    layout: Layout
    model: Model
    evaluation: Evaluation
    objective: float
    damping: float = 0.0

    @property
    def likeliness(self) -> float:
        """Twice the log-likelihood, with the declared constants as measurements; the plausible sizes of effects only
        keep a fit in hand, and say nothing of which effect it is.
        """
        declared = np.array([owner == "" for owner in self.layout.owner])
        off = ((self.model.theta - self.layout.mean) / self.layout.deviation)[declared]
        return 2.0 * self.evaluation.log_likelihood - self.evaluation.share * float(off @ off)

    @property
    def prior_deviation(self) -> Array:
        """(k,) of the parameters, beside this record."""
        return self.layout.spread(self.evaluation.share)

    @property
    def criterion(self) -> float:
        """The same, less what the parameters cost (Schwarz, Annals of Statistics 6, 1978)."""
        return self.likeliness - float(self.told.sum() * np.log(self.evaluation.count.sum()))

    @cached_property
    def told(self) -> Array:
        """(k,) how much of each parameter this record tells, 0 to 1: what it says nothing of costs nothing (MacKay,
        Neural Computation 4, 1992, 415: the number of well-determined parameters). Nothing where the motion is lost.
        """
        if not self.evaluation.sound:
            return np.zeros(len(self.model.theta))
        deviation = self.prior_deviation
        relative = self.posterior_information * np.outer(deviation, deviation)
        return np.clip(1.0 - np.diagonal(np.linalg.pinv(relative, hermitian=True)), 0.0, 1.0)

    def rise_over(self, other: "FittedModel") -> float:
        """Twice the gain of log-likelihood over another model, both counted in the more samples that the error of one
        of them has independent: what the other lacks may be slow.
        """
        share = max(self.evaluation.share, other.evaluation.share)
        return share * (self.likeliness / self.evaluation.share - other.likeliness / other.evaluation.share)

    def surplus_over(self, other: "FittedModel") -> float:
        """The same, less what the parameters cost that this model has more."""
        return self.rise_over(other) - self._price_beside(other)

    def _price_beside(self, other: "FittedModel") -> float:
        more = float(self.told.sum() - other.told.sum())
        return more * float(np.log(max(self.evaluation.count.sum(), other.evaluation.count.sum())))

    @cached_property
    def scatter(self) -> float:
        """By how much more the scores differ from part to part of the record than white innovations let them, 1 where
        they do not: one number for all parameters (White, Econometrica 50, 1982).
        """
        scores = self.evaluation.score / self.evaluation.scale
        scores = scores - scores.mean(axis=0)
        inverse = np.linalg.pinv(self.posterior_information, hermitian=True)
        return max(float(np.sum(inverse * (scores.T @ scores))) / len(inverse), 1.0)

    @cached_property
    def widening(self) -> Array:
        """(k,) the same of each parameter's own estimate, in variance, 1 where it scatters by no more."""
        inverse = np.linalg.inv(self.posterior_information)
        scores = self.evaluation.score / self.evaluation.scale
        steps = (scores - scores.mean(axis=0)) @ inverse
        parts = len(steps)
        scatter = parts / (parts - 1.0) * np.sum(steps**2, axis=0) / np.diagonal(inverse)
        return np.asarray(np.maximum(scatter, 1.0))

    @cached_property
    def covariance(self) -> Array:
        """(k, k) of the parameters: the inverse of the information, each deviation wider by how much more its own
        estimate scatters from part to part of the record than white innovations let it (White, Econometrica 50, 1982).
        """
        inverse, wider = np.linalg.inv(self.posterior_information), np.sqrt(self.widening)
        return np.asarray(inverse * np.outer(wider, wider))

    @cached_property
    def deviations(self) -> Array:
        """(k,) the same, standard, of each."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)))

    def interval(self, k: int, unit: str) -> Interval:
        """A parameter, SI, with its 95 % interval."""
        factor = float(self.layout.factor[k])
        value, half = float(self.model.theta[k] * factor), TWO_SIDED * float(self.deviations[k] * abs(factor))
        return Interval(value, value - half, value + half, unit)

    def gain_over(self, other: "FittedModel", name: str | None = None) -> float:
        """Twice the gain of log-likelihood over another model, as far as the record is sure of it, less what the
        parameters cost that this one has more (Schwarz, Annals of Statistics 6, 1978).  name: the effect that the other
        lacks, of which the record is then as sure as the intervals of its coefficients say.
        """
        scatter = self.scatter if name is None else float(np.mean(self.widening[self.layout.of(name)]))
        return self.rise_over(other) / scatter - self._price_beside(other)

    def gain_of(self, name: str) -> float:
        """`gain_over` the model with one effect less, by the parabola that the likelihood is at its top."""
        return self.without(name)[0] / self.scatter - float(
            self.told[self.layout.of(name)].sum() * np.log(self.evaluation.count.sum())
        )

    def begins_at_zero(self, name: str) -> bool:
        """Whether an effect is none where its coefficients are zero: else the parabola says nothing of a model without
        it.
        """
        return bool(np.any(self.layout.mean[self.layout.of(name)] == 0.0))

    def twice_log_likelihood_of(self, squares: float) -> float:
        """What is lost where the innovations' sum of squares is larger by that, over the noise that is left; −∞ where a
        parabola would leave less than nothing.
        """
        samples = float(self.evaluation.count.sum())
        if squares <= -samples:
            return -np.inf
        return samples * float(np.log1p(squares / samples))

    def parted(self, name: str) -> tuple[list[int], list[int]]:
        """Places of an effect's parameters, and of all others."""
        own = self.layout.of(name)
        return own, [k for k in range(len(self.layout.names)) if k not in own]

    def removed(self, name: str) -> Array:
        """By how much an effect's parameters change where it is taken out: without its coefficients, which begin at
        zero, its frequency or threshold moves nothing.
        """
        own = self.layout.of(name)
        return np.where(self.layout.mean[own] == 0.0, -self.model.theta[own], 0.0)

    def without(self, name: str) -> tuple[float, Array]:
        """By the parabola, what is lost of twice the log-likelihood without an effect, and the parameters (k,) then."""
        (own, rest), removed = self.parted(name), self.removed(name)
        left, taken = beside(self.posterior_information, own, rest)
        left = left - np.diag(self.prior_deviation[own] ** -2.0)
        theta = self.model.theta.copy()
        theta[rest] -= taken @ removed
        return self.twice_log_likelihood_of(max(float(removed @ left @ removed), 0.0)), theta

    @property
    def posterior_information(self) -> Array:
        """(k, k) of the parameters, prior included, at the noise that is left."""
        prior = np.diag(self.prior_deviation**-2.0)
        return np.asarray(self.evaluation.information.sum(axis=0) / self.evaluation.scale + prior)

    @property
    def score(self) -> Array:
        """(k,) slope of the penalised log-likelihood."""
        pull = (self.model.theta - self.layout.mean) / self.prior_deviation**2
        return np.asarray(self.evaluation.score.sum(axis=0) / self.evaluation.scale - pull)


def at(of: Likelihood, layout: Layout, model: Model) -> FittedModel:
    """A model where it stands."""
    evaluation = of.evaluate(layout, model)
    return FittedModel(layout, model, evaluation, _penalised(layout, model, evaluation))


def _penalised(layout: Layout, model: Model, evaluation: Evaluation) -> float:
    pull = (model.theta - layout.mean) / layout.spread(evaluation.share)
    return evaluation.log_likelihood - 0.5 * float(pull @ pull)


def maximise(of: Likelihood, start: FittedModel, passes: int = PASSES, rise: float = SETTLED) -> FittedModel:
    """The top next to `start`, at the noise that `start` has: to within so much of the log-likelihood (Levenberg and
    Marquardt; the damping follows the share of the expected rise that comes).
    """
    now, damping = start, start.damping
    for _ in range(passes):
        if not now.evaluation.sound:
            return now
        information, score = now.posterior_information, now.score
        damped = information + damping * np.diag(np.diag(information))
        try:
            theta = _stepped(now, damped, score)
        except np.linalg.LinAlgError:
            return now
        step = theta - now.model.theta
        expected = float(score @ step - 0.5 * step @ information @ step)
        if expected < rise:
            break
        moved = at(of, now.layout, replace(now.model, theta=theta))
        risen = moved.objective - now.objective
        if risen > 0.0:
            now = moved
        if not risen > AS_EXPECTED * expected:
            damping = max(10.0 * damping, 1e-2)
        elif risen > (1.0 - AS_EXPECTED) * expected:
            damping = damping / 10.0 if damping > 1e-2 else 0.0
        if damping > 1e4:
            break
    return replace(now, damping=damping)


def _stepped(now: FittedModel, information: Array, score: Array) -> Array:
    """Parameters (k,) one step on; where a bound stops some of them, the step that is best for the others."""
    theta, bounded = now.model.theta, now.layout.bounded
    free, step = np.ones(len(theta), dtype=bool), np.zeros(len(theta))
    while free.any():
        held = np.where(free, 0.0, step)
        step = held.copy()
        step[free] = np.linalg.solve(information[np.ix_(free, free)], (score - information @ held)[free])
        stopped = free & (bounded(theta + step) != theta + step)
        step = np.where(free & ~stopped, step, bounded(theta + step) - theta)
        if not stopped.any():
            break
        free &= ~stopped
    return np.asarray(bounded(theta + step))


def advanced(of: Likelihood, start: FittedModel) -> FittedModel:
    """Some way on to the top in parameters and random force.

    Far from the top, what the parameters leave is a random force to the filter, which follows the motion all the same;
    the nearer they come, the quieter it is, and the sharper the likelihood.
    """
    now = maximise(of, start, ROUGH, RISE)
    model = of.quieten(now.layout, now.model)
    return now if model.noise == now.model.noise else replace(at(of, now.layout, model), damping=now.damping)


def settle(of: Likelihood, start: FittedModel) -> FittedModel:
    """The top of the likelihood in parameters and random force, from `start` on."""
    now = start
    for _ in range(PASSES):
        before = now
        now = advanced(of, now)
        same = now.model.noise == before.model.noise
        if same and now.objective - before.objective < RISE:
            break
    return maximise(of, now, rise=RISE)


def finished(of: Likelihood, start: FittedModel) -> FittedModel:
    """The same with all levels of noise fitted."""
    now = at(of, start.layout, of.fit_noise(start.layout, start.model))
    return maximise(of, now, rise=RISE)


def fit(of: Likelihood, effects: Effects) -> FittedModel:
    """The model with these effects, from what is declared: on a beginning of the record first, where a wrong stiffness
    has not lost count of the cycles, and then on more and more of it.
    """
    layout = of.layout(effects)
    length = min(of.first, of.samples)
    model = of.part(slice(0, length)).at_first(layout, Model(effects, layout.mean, of.declared_noise()))
    while True:
        part = of.part(slice(0, length))
        found = settle(part, at(part, layout, part.quieten(layout, model)))
        if length == of.samples:
            return finished(part, found)
        model, length = found.model, min(GROWTH * length, of.samples)
