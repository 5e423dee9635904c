"""Which effects are chosen: by a search on a beginning of the record, fitted to more of it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from estimator.identification.ambiguity import Member, exchanged
from estimator.identification.fit import FittedModel, at, finished, maximise, settle
from estimator.identification.likelihood import Likelihood
from estimator.identification.search import Search, backward, forward, search

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


def choose(of: Likelihood, progress: Callable[[str, int, int], None] = lambda stage, done, total: None) -> Chosen:
    """Effects chosen on a beginning of the record and fitted to more of it."""
    searched, fitted = (of.part(slice(0, min(of.samples, most))) for most in (SEARCHED, REFINED))
    corrected = searched.following is searched
    found = search(searched, progress) if corrected else by_free_runs(searched, progress)
    best, groups = exchanged(searched, found.best)
    while corrected and (less := backward(searched, best, found.margin)) is not best:
        best, groups = exchanged(searched, less)
    before = found.base
    if fitted.samples > searched.samples:
        before, best = (settle(fitted, at(fitted, one.layout, one.model)) for one in (before, best))
    if not corrected:
        best = backward(fitted, best, found.margin)
    return Chosen(fitted, found, before, maximise(fitted, best), groups)


def by_free_runs(of: Likelihood, progress: Callable[[str, int, int], None]) -> Search:
    """Effects added by a run that nothing corrects, from what its filter finds and from what is declared: the better.

    A filter keeps the motion, whatever a model lacks, and is blind for what it is corrected for all the time; a run
    tells all, once it keeps the motion.
    """
    by_filter = search(of.following, progress)
    begun = [freed(of, one) for one in (by_filter.best, by_filter.base)]
    found = [forward(of, progress, one) for one in (begun if by_filter.best is not by_filter.base else begun[:1])]
    noise = min((one.best for one in found), key=lambda best: best.evaluation.scale).model.noise
    best = max(found, key=lambda one: at(of, one.best.layout, replace(one.best.model, noise=noise)).criterion)
    rounds = (*by_filter.rounds, *found[0].rounds) if best is found[0] else best.rounds
    return Search(begun[-1], best.best, rounds)


def freed(of: Likelihood, followed: FittedModel) -> FittedModel:
    """A model that was fitted by a filter, by a run that nothing corrects."""
    model = replace(followed.model, noise=replace(followed.model.noise, force=of.declared_noise().force))
    return finished(of, settle(of, at(of, followed.layout, model)))
