"""The parameters of a model by maximum likelihood: Gauss and Newton with priors and damping."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimator.identification.likelihood import Evaluation, Layout, Likelihood, Model
from estimator.scaling import Array
from estimator.trace.problem import Effects

PASSES = 12
"""Gauss–Newton converges in three to six; more are a fit that has no top nearby."""
ROUGH = 2
"""Passes between two estimates of the noise."""
GROWTH = 4
"""By how much the next part that is fitted is longer than the one before."""
RISE = 1.0
"""Of the log-likelihood, below which another round with another noise is not worth its passes."""
SETTLED = 0.02
"""Expected rise of the penalised log-likelihood below which a fit is at its top: a seventh of a deviation."""


@dataclass(frozen=True)
class FittedModel:
    """A model at its top: layout of its parameters, the pass there, the penalised log-likelihood; converged: whether
    the last step expected no more.
    """

    layout: Layout
    model: Model
    evaluation: Evaluation
    objective: float
    converged: bool

    @property
    def likeliness(self) -> float:
        """Twice the log-likelihood, with the declared constants as measurements; the plausible sizes of effects only
        keep a fit in hand, and say nothing of which effect it is.
        """
        declared = np.array([owner == "" for owner in self.layout.owner])
        off = ((self.model.theta - self.layout.mean) / self.layout.deviation)[declared]
        return 2.0 * self.evaluation.log_likelihood - float(off @ off)

    @property
    def criterion(self) -> float:
        """The same, less what the parameters cost (Schwarz, Annals of Statistics 6, 1978)."""
        return self.likeliness - len(self.layout.names) * float(np.log(self.evaluation.count.sum()))

    @cached_property
    def scatter(self) -> float:
        """By how much more the scores differ from part to part of the record than white innovations let them, 1 where
        they do not: one number for all parameters (White, Econometrica 50, 1982).
        """
        scores = self.evaluation.score / self.evaluation.scale
        scores = scores - scores.mean(axis=0)
        inverse = np.linalg.pinv(self.posterior_information, hermitian=True)
        return max(float(np.sum(inverse * (scores.T @ scores))) / len(inverse), 1.0)

    def gain_over(self, other: "FittedModel") -> float:
        """Twice the gain of log-likelihood over another model, as far as the record is sure of it, less what the
        parameters cost that this one has more (Schwarz, Annals of Statistics 6, 1978).
        """
        more = len(self.layout.names) - len(other.layout.names)
        samples = float(self.evaluation.count.sum())
        return (self.likeliness - other.likeliness) / self.scatter - more * float(np.log(samples))

    @property
    def posterior_information(self) -> Array:
        """(k, k) of the parameters, prior included, at the noise that is left."""
        prior = np.diag(self.layout.deviation**-2.0)
        return np.asarray(self.evaluation.information.sum(axis=0) / self.evaluation.scale + prior)

    @property
    def score(self) -> Array:
        """(k,) slope of the penalised log-likelihood."""
        pull = (self.model.theta - self.layout.mean) / self.layout.deviation**2
        return np.asarray(self.evaluation.score.sum(axis=0) / self.evaluation.scale - pull)


def at(of: Likelihood, layout: Layout, model: Model) -> FittedModel:
    """A model where it stands."""
    evaluation = of.evaluate(layout, model)
    return FittedModel(layout, model, evaluation, _penalised(layout, model, evaluation), converged=False)


def _penalised(layout: Layout, model: Model, evaluation: Evaluation) -> float:
    pull = (model.theta - layout.mean) / layout.deviation
    return evaluation.log_likelihood - 0.5 * float(pull @ pull)


def maximise(of: Likelihood, start: FittedModel, passes: int = PASSES) -> FittedModel:
    """The top next to `start`, at the noise that `start` has."""
    now, damping = start, 0.0
    for _ in range(passes):
        if not now.evaluation.sound:
            return now
        information, score = now.posterior_information, now.score
        damped = information + damping * np.diag(np.diag(information))
        theta, layout = now.model.theta, now.layout
        # A parameter at a bound that the score would have it cross stays there.
        free = ~((theta <= layout.least) & (score < 0.0) | (theta >= layout.most) & (score > 0.0))
        step = np.zeros(len(theta))
        try:
            step[free] = np.linalg.solve(damped[np.ix_(free, free)], score[free])
        except np.linalg.LinAlgError:
            return now
        if 0.5 * float(score @ step) < SETTLED:
            return replace(now, converged=True)
        theta = np.clip(theta + step, layout.least, layout.most)
        moved = at(of, now.layout, replace(now.model, theta=theta))
        if moved.objective > now.objective:
            now, damping = moved, damping / 10.0 if damping > 1e-3 else 0.0
        else:
            damping = max(10.0 * damping, 1e-2)
            if damping > 1e4:
                return now
    return now


def advanced(of: Likelihood, start: FittedModel) -> FittedModel:
    """Some way on to the top in parameters and random force.

    Far from the top, what the parameters leave is a random force to the filter, which follows the motion all the same;
    the nearer they come, the quieter it is, and the sharper the likelihood.
    """
    now = maximise(of, start, ROUGH)
    model = of.quieten(now.layout, now.model)
    return now if model.noise == now.model.noise else at(of, now.layout, model)


def settle(of: Likelihood, start: FittedModel) -> FittedModel:
    """The top of the likelihood in parameters and random force, from `start` on."""
    now = start
    for _ in range(PASSES):
        before = now
        now = advanced(of, now)
        same = now.model.noise == before.model.noise
        if same and now.objective - before.objective < RISE:
            break
    return maximise(of, now)


def finished(of: Likelihood, start: FittedModel) -> FittedModel:
    """The same with all levels of noise fitted."""
    now = at(of, start.layout, of.fit_noise(start.layout, start.model))
    return maximise(of, now)


def fit(of: Likelihood, effects: Effects) -> FittedModel:
    """The model with these effects, from what is declared: on a beginning of the record first, where a wrong stiffness
    has not lost count of the cycles, and then on more and more of it.
    """
    layout = of.layout(effects)
    model = Model(effects, layout.mean, of.declared_noise())
    length = min(of.first, of.samples)
    while True:
        part = of.part(slice(0, length))
        found = settle(part, at(part, layout, part.quieten(layout, model)))
        if length == of.samples:
            return finished(part, found)
        model, length = found.model, min(GROWTH * length, of.samples)
