"""Who comes as near as the effect that was taken once both are carried: a record does not tell them apart."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.trace.candidates import Parameters, kind
from estimator.trace.criterion import TIE, schwarz
from estimator.trace.dispersion import dispersed
from estimator.trace.engine import Step, Trial
from estimator.trace.fitting import Fitted, deficit, parameters_of
from estimator.trace.look import Look
from estimator.trace.nested import simpler_than
from estimator.trace.observer_model import Carrying, numbers, told
from estimator.trace.probability import NOTHING, Account, nearest
from estimator.trace.scan import PARTS
from estimator.trace.searched import NOTHING as NOT_SEARCHED
from estimator.trace.searched import Searched


@dataclass(frozen=True)
class Rival:
    """Another account of what an effect was taken for.

    deficit: by how much less its likelihood is, price included, in twice the log-likelihood, over the whole record or
    behind its first part, if it is less there: what the observer's start alone tells hangs on how it was linearised;
    bound: a deficit that would be worth odds of 20 to 1; parameters: with which it was carried; searched: how surely
    they are known.
    """

    deficit: float
    bound: float
    parameters: Parameters
    searched: Searched = NOT_SEARCHED


def rivals(step: Step[Carrying]) -> Mapping[str, Rival]:
    """The candidates of other kinds that the record does not tell from the one taken, the nearest first."""
    others = ((name, trial) for name, trial in step.beside.items() if kind(name) != kind(step.name))
    found = {name: rival for name, trial in others if (rival := _rival(step.name, step.trial, name, trial))}
    return dict(sorted(found.items(), key=lambda item: item[1].deficit))


def simpler_rival(best: str, trials: Mapping[str, Trial[Carrying]]) -> str | None:
    """`estimator.trace.engine.Rules.simpler` of the bench's observer: what would be a rival of the best if innovations
    were white.  Where they are far from that, something is missing, and a difference that is unsure is no reason to
    turn down the better.
    """
    simpler = simpler_than(best)
    if simpler in trials and _behind(best, trials[best], simpler, trials[simpler]) < TIE:
        return simpler
    return None


def _rival(taken: str, by: Trial[Carrying], name: str, trial: Trial[Carrying]) -> Rival | None:
    """The other as an account of what `taken` was taken for; None where the record tells them apart."""
    behind = _behind(taken, by, name, trial)
    bound = TIE * max(dispersion(by.fit.fitted, trial.fit.fitted), 1.0)
    if not behind < bound:
        return None
    return Rival(behind, bound, parameters_of(trial.fit.fitted, name), trial.fit.searched.get(name, NOT_SEARCHED))


def _behind(taken: str, by: Trial[Carrying], name: str, trial: Trial[Carrying]) -> float:
    """By how much less the likelihood of the other is, price included."""
    return _price(name, trial) - _price(taken, by) + deficit(by.fit.fitted, trial.fit.fitted)


def accounts(step: Step[Carrying], look: Look) -> tuple[Account, ...]:
    """All that was asked in the round in which an effect was taken: those that were carried by their likelihoods, those
    that were only watched by what the scan promises, taken down by its scatter; and nothing.
    """
    taken = step.trial
    price = _price(step.name, taken)
    found = [Account(step.name, 0.0), _account(NOTHING, taken.fit.fitted, step.before.fitted, -price)]
    for name, trial in step.beside.items():
        found.append(_account(name, taken.fit.fitted, trial.fit.fitted, _price(name, trial) - price))
    reached = taken.score.gain - price
    carried = {kind(one.name) for one in found}
    return nearest((*found, *(one for one in _watched(look, reached) if kind(one.name) not in carried)))


def in_the_end(found: tuple[Account, ...], step: Step[Carrying], last: Carrying) -> tuple[Account, ...]:
    """The same with nothing in its place where `last` carries all that was taken: while something else was missing, the
    record was less sure of what each effect is for.
    """
    if step.name not in last.less:
        return found
    less, _ = last.less[step.name]
    nothing = _account(NOTHING, last.fitted, less.fitted, -_price(step.name, step.trial))
    return tuple(nothing if one.name == NOTHING else one for one in found)


def left_out(look: Look) -> tuple[Account, ...]:
    """The same of a round in which nothing was taken, beside nothing."""
    return nearest((Account(NOTHING, 0.0), *_watched(look, 0.0)))


def _price(name: str, trial: Trial[Carrying]) -> float:
    """Of the numbers that the record tells something of: what it does not tell makes no account less probable.

    Schwarz's ln n stands for the logarithm of what n samples tell of a number.  Of a parameter that was searched for
    that is known, the square of its size over its deviation; where it is less than that of n, it is the price.
    """
    problem = trial.fit.problem
    every, known = numbers(name, problem.device), told(name, problem)
    each = trial.score.price / every
    if known < every:  # a mode, of whose parameters nothing is told
        return each * known
    searched, given = trial.fit.searched.get(name, NOT_SEARCHED), parameters_of(trial.fit.fitted, name)
    _, effect = effect_for(name, problem.device.axes, problem.device.own)
    found = [p.name for p in effect.parameters if p.found_as is None and p.name in searched.names]
    prices = [min(each, math.log1p(_precision(given[one], searched.deviation(one)))) for one in found]
    return each * (every - len(found)) + sum(prices)


def _precision(value: float, deviation: float) -> float:
    """How often the variance goes into the square, 0 of a parameter of which the search found no top."""
    return (value / deviation) ** 2 if deviation > 0.0 else 0.0


def _account(name: str, taken: Fitted, other: Fitted, price: float) -> Account:
    return Account(name, price + deficit(taken, other), dispersion(taken, other))


def _watched(look: Look, reached: float) -> list[Account]:
    samples = look.seen.innovation.size
    return [
        Account(name, reached - (item.gain / max(item.scatter, 1.0) - schwarz(_numbers(look, name), samples)))
        for name, item in look.evidence.items()
    ]


def _numbers(look: Look, name: str) -> int:
    return numbers(name, look.seen.observer.device)


def dispersion(model: Fitted, other: Fitted) -> float:
    """By how much a difference of the two likelihoods is less sure than white innovations would make it, behind the
    first part of the record: what the start of either pass tells hangs on how it was linearised, and is no noise.
    """
    with np.errstate(invalid="ignore"):
        one, two = (fitted.estimates.innovation / fitted.estimates.innovation_deviation for fitted in (model, other))
    first = math.ceil(len(one) / PARTS)
    return dispersed(one[first:], two[first:])
