"""Which effects are chosen: by a search on a beginning of the record, fitted to more of it."""

from dataclasses import dataclass, replace

from estimator.trace.ambiguity import Member, exchanged
from estimator.trace.fit import FittedModel, at, finished, fit, maximise, settle
from estimator.trace.likelihood import AT_FLOOR, Likelihood
from estimator.trace.problem import Progress, unseen
from estimator.trace.search import QUICK, Search, backward, forward, search, with_defaults

SEARCHED = 25_000
"""Samples of the fitted part on which effects are chosen: what shows in more only is small."""
REFINED = 100_000
"""... and on which what was chosen is fitted: beyond, coefficients are surer than any model."""


@dataclass(frozen=True)
class Chosen:
    """What was chosen: on how much of the record, by which search; the models before and after, fitted to `of`; what
    may stand in the place of each effect.
    """

    of: Likelihood
    found: Search
    before: FittedModel
    after: FittedModel
    groups: dict[str, list[Member]]

    @property
    def named(self) -> list[str]:
        """The effects that were added."""
        return [name for name in self.after.model.effects if name not in self.before.model.effects]


def choose(of: Likelihood, progress: Progress = unseen) -> Chosen:
    """Effects chosen on a beginning of the record and fitted to more of it."""
    searched, fitted = (of.part(slice(0, min(of.samples, most))) for most in (SEARCHED, REFINED))
    corrected = searched.following is searched
    found = search(searched, progress) if corrected else by_free_runs(searched, progress)
    best, groups = exchanged(searched, found.best)
    while corrected and (less := backward(searched, best, found.margin)) is not best:
        best, groups = exchanged(searched, less)
    best = with_defaults(searched, best)
    before = found.base
    if fitted.samples > searched.samples:
        before, best = (settle(fitted, at(fitted, one.layout, one.model)) for one in (before, best))
    if not corrected:
        best = backward(fitted, best, found.margin)
    return Chosen(fitted, found, before, maximise(fitted, best), groups)


def by_free_runs(of: Likelihood, progress: Progress) -> Search:
    """Effects added by a run that nothing corrects; where it leaves more than the noise floor, from what a filter finds
    on a beginning of the record as well, and the better of both.

    A filter keeps the motion, whatever a model lacks, and is blind for what it is corrected for all the time; a run
    tells all, once it keeps the motion.
    """
    quick = of.following.part(slice(0, QUICK))
    begun = [fit(of, of.effects), freed(of, fit(quick, of.effects))]
    found = forward(of, progress, max(begun, key=lambda one: one.surplus_over(begun[0])))
    if of.above_floor(found.best.evaluation, None) < AT_FLOOR:
        return found
    by_filter = search(quick, progress)
    if by_filter.best is by_filter.base:
        return found
    other = forward(of, progress, freed(of, by_filter.best))
    if other.best.surplus_over(found.best) <= 0.0:
        return found
    return Search(found.base, other.best, (*by_filter.rounds, *other.rounds))


def freed(of: Likelihood, followed: FittedModel) -> FittedModel:
    """A model that was fitted by a filter, by a run that nothing corrects."""
    model = replace(followed.model, noise=replace(followed.model.noise, force=of.declared_noise().force))
    return finished(of, settle(of, at(of, followed.layout, model)))
