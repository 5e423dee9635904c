"""Which effects a device of two axes lacks: one after another, each the one that explains most, as exactly as the model
goes.

A scan of the record tells how much every effect of the catalogue would explain and who looks like whom; the few that
come into question are then carried by an observer each, and their likelihoods decide.  Each effect taken is carried
from then on, and the residual that is left is scanned again.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

from estimator.errors import DivergedError
from estimator.side_by_side import together
from estimator.thresholds import THRESHOLDS
from estimator.trace.candidates import is_line, kind
from estimator.trace.engine import Chosen, Dissent, Estimate, Round, Rules, choose, exchanged, pruned
from estimator.trace.fitting import Fitted, coefficients_of, fit, widening
from estimator.trace.longer import gone_on, shows_later
from estimator.trace.look import Look
from estimator.trace.nested import simpler_in
from estimator.trace.observer_model import Carrying, ObserverModel, estimates_of
from estimator.trace.parameters import refine_in_turn, refine_parameters
from estimator.trace.prediction_error import by_prediction_error
from estimator.trace.probability import Account
from estimator.trace.problem import Effects, Problem
from estimator.trace.rivals import Rival, accounts, in_the_end, left_out, rivals, simpler_rival
from estimator.trace.same_number import effects_of
from estimator.trace.searched import Searched
from estimator.trace.ways import best_way

_SET = THRESHOLDS.choice

T = TypeVar("T")

MOST = _SET.most
"""Effects that are named at most: with more the model is a patchwork, and none of them the cause."""

RULES = Rules(
    MOST, Dissent.ENDS, anew=True, near=THRESHOLDS.width.refined, last=is_line, simpler=simpler_rival,
    nested=simpler_in,
)  # fmt: skip
"""What came out with a wrong sign may have stood in for another that is missing: it is tried again beside that one."""


@dataclass(frozen=True)
class Selection:
    """Effects in the order in which they were taken, with their coefficients; the rounds; who looked like each that was
    taken, there, and who came as near once carried; how all accounts of each round compare, by who was taken, of the
    first where nobody was, by none; models before and after; what each gained; how surely the parameters that were
    searched for are known; whether there are as many as may be and still something is left.
    """

    effects: Effects
    rounds: tuple[Round[Look], ...]
    alike: Mapping[str, Mapping[str, float]]
    rivals: Mapping[str, Mapping[str, Rival]]
    accounts: Mapping[str | None, tuple[Account, ...]]
    before: Fitted
    after: Fitted
    gain: Mapping[str, float]
    searched: Mapping[str, Searched]
    patchwork: bool

    @property
    def samples(self) -> int:
        """How many samples the models were fitted to."""
        return len(self.after.estimates.innovation)

    @property
    def coefficients(self) -> Mapping[str, Mapping[str, Estimate]]:
        """By effect, with their intervals."""
        return estimates_of(self.after, self.searched)


Progress = Callable[[str, int, int], None]


def select(problem: Problem, progress: Progress) -> Selection:
    """Choose effects on the record of `problem`, the part to be fitted, beside those that it carries already."""
    compared = problem.part(slice(0, _SET.compared))
    start = Carrying(compared, fit(compared))
    if not math.isfinite(start.fitted.likelihood):
        raise DivergedError
    family = ObserverModel(compared, progress)
    rounds_done = partial(progress, "effects")
    found = best_way(family, choose(family, start, RULES, rounds_done, reducible=family), RULES, rounds_done)
    chosen = pruned(family, found)
    more = problem.part(slice(0, _SET.confirmed))
    long = len(problem.record) >= _SET.worth_more * len(compared.record)
    longer = len(more.record) > len(compared.record)
    kept = [step for step in chosen.steps if step.name in chosen.gains]
    tied = len(more.record) >= _SET.worth_telling * len(compared.record) and any(map(rivals, kept))
    if long or tied or (longer and shows_later(more, chosen.fit.fitted)):
        family = ObserverModel(more, progress)
        found = gone_on(family, chosen, RULES, rounds_done)
        chosen = pruned(family, found)
    carrying = found.fit
    model, searched = carrying.fitted, dict(carrying.searched)
    effects = coefficients_of(chosen.fit.fitted.observer)
    whole = len(problem.record) > len(carrying.problem.record)
    longer = len(problem.record) > len(start.problem.record)
    pruned_too = len(effects) < len(model.observer.effects)

    def over_the_whole(found: Fitted) -> Fitted:
        return fit(problem.under(found.settings), passes=1, about=found.observer)

    def with_effects() -> Fitted:
        found = chosen.fit.fitted
        if whole and math.isfinite(found.likelihood):
            return over_the_whole(found)
        return fit(problem.under(model.settings).carrying(effects)) if whole or pruned_too else model

    if chosen.steps:
        before, last = together(lambda: over_the_whole(start.fitted) if longer else start.fitted, with_effects)
    else:
        before = last = with_effects()
    explains = widening(last) ** 2 < THRESHOLDS.parameters.explains
    if not chosen.more and explains and (whole or len(chosen.gains) > 1):
        last, searched = refine_in_turn(problem, last, searched, chosen.gains)
    return Selection(
        effects=effects_of(last, searched),
        rounds=chosen.rounds,
        alike={one.taken: one.look.alike(one.taken) for one in chosen.rounds if one.taken is not None},
        rivals={step.name: rivals(step) for step in chosen.steps},
        accounts=_accounts(chosen),
        before=before,
        after=last,
        gain=chosen.gains,
        searched=searched,
        patchwork=chosen.more,
    )


def _accounts(chosen: Chosen[Carrying, Look]) -> dict[str | None, tuple[Account, ...]]:
    looks = {one.taken: one.look for one in chosen.rounds if one.taken is not None}
    found: dict[str | None, tuple[Account, ...]] = {
        step.name: in_the_end(accounts(step, looks[step.name]), step, chosen.fit) for step in chosen.steps
    }
    return found or {None: left_out(chosen.rounds[0].look)}


def without(problem: Problem, selection: Selection, names: Collection[str]) -> Selection:
    """What was selected on the record of `problem` less these, the rest fitted anew; parameters stay where they are."""
    rest = {name: given for name, given in selection.effects.items() if name not in names}
    kept = {name: gain for name, gain in selection.gain.items() if name not in names}
    after = fit(problem.under(selection.after.settings).carrying(rest)) if kept else selection.before
    return replace(selection, effects=effects_of(after, selection.searched), after=after, gain=kept)


def exactly(problem: Problem, selection: Selection, progress: Progress, *, unless_right: bool = False) -> Selection:
    """What was selected on the record of `problem`, its constants and coefficients by `by_prediction_error`; with
    `unless_right`, `selection` itself where those of the filter are as good.
    """
    told = partial(progress, "constants")
    after = by_prediction_error(problem, selection.after, unless_right=unless_right, told=told)
    if after is selection.after:
        return selection
    return replace(selection, effects=effects_of(after, selection.searched), after=after)


def instead(problem: Problem, selection: Selection, name: str, other: str) -> Selection:
    """What was selected on the record of `problem` with a rival in the place of one of its effects, the rest fitted
    anew; the effect that it replaces is no rival of it, nor like it: whoever asks for this knows them apart.
    """
    rival = selection.rivals[name][other]
    kept = {one: given for one, given in selection.effects.items() if one != name}
    after = fit(problem.under(selection.after.settings).carrying({**kept, other: rival.parameters}))
    known = rival.searched
    if math.isfinite(after.likelihood):
        after, known = refine_parameters(problem, after, other, before=known)
    searched = {one: found for one, found in selection.searched.items() if one != name} | {other: known}
    looks = {one.taken: one.look for one in selection.rounds}
    shifted = {
        one: replace(each, deficit=each.deficit - rival.deficit)
        for one, each in selection.rivals[name].items()
        if one != other
    }
    gained = selection.gain[name] + after.likelihood - selection.after.likelihood

    def renamed(found: Mapping[str, T], new: T) -> dict[str, T]:
        return {other if one == name else one: new if one == name else each for one, each in found.items()}

    alike = {one: each for one, each in looks[name].alike(other).items() if kind(one) != kind(name)}
    accounts = tuple(replace(one, deficit=one.deficit - rival.deficit) for one in selection.accounts[name])
    return replace(
        selection,
        effects=effects_of(after, searched),
        rounds=tuple(exchanged(one, other) if one.taken == name else one for one in selection.rounds),
        alike=renamed(selection.alike, alike),
        rivals=renamed(selection.rivals, shifted),
        accounts={
            other if one == name else one: accounts if one == name else each for one, each in selection.accounts.items()
        },
        after=after,
        gain=renamed(selection.gain, gained),
        searched=searched,
    )
