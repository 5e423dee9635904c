"""A choice that was made on the beginning of a long record, over more of it.

On the beginning candidates are told apart for a fraction of what that costs over all of it.  What it does not tell
apart is carried over more of the record, where what differs at all differs by more; and what it leaves is scanned
there once more, for an effect that is too small to show on the beginning.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from estimator.side_by_side import side_by_side
from estimator.trace.engine import Chosen, Rules, Step, Trial, choose, exchanged, plainest, unphysical
from estimator.trace.fitting import Fitted, coefficients_of, fit, is_as_predicted, parameters_of
from estimator.trace.look import Look, look_at
from estimator.trace.nested import turned_into
from estimator.trace.observer_model import Carrying, ObserverModel
from estimator.trace.parameters import refine_in_turn, refine_parameters
from estimator.trace.problem import Problem
from estimator.trace.rivals import Rival, rivals
from estimator.trace.searched import NOTHING
from estimator.trace.width import leaders


def shows_later(problem: Problem, model: Fitted) -> bool:
    """Whether a model of the beginning, at the floor there, leaves something over the record of `problem`, which is
    more of it, or an effect promises something there: what acts by the amplitude, the rate or the angle may show only
    when those have moved, and what the constants took up on the beginning they may not take up on the rest.
    """
    if not is_as_predicted(model):
        return False
    later = fit(problem.under(model.settings), passes=1, about=model.observer)
    return not is_as_predicted(later) or bool(leaders(look_at(problem, later)))


def gone_on(
    family: ObserverModel,
    chosen: Chosen[Carrying, Look],
    rules: Rules,
    progress: Callable[[int, int], None] = lambda done, most: None,
) -> Chosen[Carrying, Look]:
    """`chosen`, which was pruned, over the record of `family`, of which it has seen the beginning; unchanged where the
    observer loses that.

    What explains more than chance on the beginning and was not taken all the same is no matter of how long the record
    is: nobody else is looked for then.
    """
    current = _over(family.problem, chosen.fit)
    if not math.isfinite(current.fitted.likelihood):
        return chosen
    steps, rounds = list(chosen.steps), list(chosen.rounds)
    for number, step in enumerate(chosen.steps):
        if step.name not in chosen.gains or not (near := rivals(step)):
            continue
        at = next(at for at, one in enumerate(rounds) if one.taken == step.name)
        steps[number] = told = _told_apart(family, current, step, near, rounds[at].look, rules)
        current = told.trial.fit
        if told.name != step.name:
            rounds[at] = exchanged(rounds[at], told.name)
    names = {before.name: now.name for before, now in zip(chosen.steps, steps, strict=True)}
    found = replace(
        chosen,
        steps=tuple(steps),
        rounds=tuple(rounds),
        gains={names[name]: gain for name, gain in chosen.gains.items()},
        fit=current,
    )
    last = found.rounds[-1]
    if found.more or any(one.score is not None and one.score.gain > one.score.bar for one in last.tried):
        return found
    left = replace(rules, most=rules.most - len(found.gains))
    further = choose(family, current, left, progress, reducible=family)
    first, *others = further.rounds
    asked = {one.name for one in first.tried}
    first = replace(first, tried=(*first.tried, *(one for one in last.tried if one.name not in asked)))
    return Chosen(
        steps=(*found.steps, *further.steps),
        rounds=(*found.rounds[:-1], first, *others),
        barred={**found.barred, **further.barred},
        more=further.more,
        gains={**found.gains, **further.gains},
        fit=further.fit,
    )


def _over(problem: Problem, found: Carrying) -> Carrying:
    """A model of the beginning over the record of `problem`, its parameters where they are best there; by as many
    passes as those that it is compared with, for one about what the beginning told has less of its start in it.
    """
    fitted = fit(problem.under(found.fitted.settings))
    fitted, searched = refine_in_turn(problem, fitted, found.searched, found.searched)
    return Carrying(problem, fitted, searched)


def _told_apart(
    family: ObserverModel, current: Carrying, step: Step[Carrying], near: Mapping[str, Rival], look: Look, rules: Rules
) -> Step[Carrying]:
    """The step as it is made over the record of `family`, by the one that it was made by or by one that came near it;
    current: what is carried, with the step; look: what was seen when it was made.
    """
    less, kept = family.without(current, step.name)
    theirs = side_by_side([partial(_instead, family.problem, less, name, step.beside[name].fit) for name in near])
    fits = {
        name: one
        for name, one in zip(near, theirs, strict=True)
        if math.isfinite(one.fitted.likelihood)
        and turned_into(family.problem, name, parameters_of(one.fitted, name)) is None
        and not unphysical(family.coefficients(one))
    }
    scores = family.score(less, look, fits) if fits else {}
    trials = {step.name: Trial(current, kept)} | {name: Trial(fits[name], scores[name]) for name in fits}
    best = plainest(trials, rules)
    if best != step.name and family.objection(less, best, trials[best]) is not None:
        best = step.name
    return Step(best, trials[best], less, {name: trial for name, trial in trials.items() if name != best})


def _instead(problem: Problem, less: Carrying, name: str, theirs: Carrying) -> Carrying:
    """`less` and beside it an effect as `theirs` has it, of the beginning."""
    effects = {**coefficients_of(less.fitted.observer), name: coefficients_of(theirs.fitted.observer)[name]}
    fitted = fit(problem.under(less.fitted.settings).carrying(effects))
    known = theirs.searched.get(name, NOTHING)
    if math.isfinite(fitted.likelihood):
        fitted, known = refine_parameters(problem, fitted, name, before=known)
    return Carrying(problem, fitted, {**less.searched, name: known})
