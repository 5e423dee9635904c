"""The choice of effects: one after another, each the one that explains most for its price.

What a model is, how it is fitted, whom to try and what a gain is counted in, a family says (`Model`); how many are
taken and what follows when the part of the record that has no vote objects, its rules say (`Rules`).  Gains and prices
are in twice the log-likelihood.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Generic, Protocol, TypeVar

from estimator.written import significant
from evaluation.measured.criterion import TIE

OUTWEIGHED = 0.5  # of a gain: a law that stands in for another, with the other sign, gains about as much
_TRIFLE = 0.02  # of the largest coefficient
_POLARITY = 2.0  # × the declared gain, or its inverse

Fit = TypeVar("Fit")
Look = TypeVar("Look")


@dataclass(frozen=True)
class Score:
    """How a model with one effect more compares: its likelihood, but for a constant that is the same for all that are
    compared; what it gains over the model without the effect; what the effect costs, which settles who is best; and
    what the gain must exceed.
    """

    likelihood: float
    gain: float
    price: float
    bar: float

    @property
    def standing(self) -> float:
        """Likelihood less price: the largest is the best."""
        return self.likelihood - self.price


@dataclass(frozen=True)
class Estimate:
    """A coefficient with its 95 % interval, SI; positive: whether it is declared to be; shape: whether it says how the
    effect is and not how large; gain: whether it is relative to a declared gain, which has the other sign below −1.
    """

    value: float
    low: float
    high: float
    positive: bool = False
    shape: bool = False
    gain: bool = False

    @property
    def is_polarity(self) -> bool:
        """Whether a relative gain is of the other sign beyond doubt, and of about the size that is declared."""
        most = _POLARITY
        return self.gain and self.high < -1.0 and 1.0 / most <= -1.0 - self.value <= most


class Outcome(Enum):
    """What became of a candidate that was carried."""

    TAKEN = "taken"
    IMPOSSIBLE = "impossible"  # no model with it
    UNPHYSICAL = "unphysical"  # a coefficient of the wrong sign
    TOO_DEAR = "too dear"  # its gain does not exceed the bar
    OBJECTED = "objected"  # the part without a vote is against it
    AFTER = "after"  # follows one that was objected to
    BEATEN = "beaten"  # another was better
    NESTED = "nested"  # for all that the record tells it is a simpler one
    SUPERFLUOUS = "superfluous"  # was taken, and those taken later do without it


@dataclass(frozen=True)
class Tried:
    """A candidate that was carried: its score and its coefficients, where there is a model, and what became of it."""

    name: str
    outcome: Outcome
    reason: str
    score: Score | None
    coefficients: Mapping[str, Estimate]


@dataclass(frozen=True)
class Round(Generic[Look]):
    """What was seen, everyone who was carried, in that order, and the one that was taken."""

    look: Look
    tried: tuple[Tried, ...]
    taken: str | None

    @property
    def gains(self) -> dict[str, float]:
        """By name, of those that have a score."""
        return {one.name: one.score.gain for one in self.tried if one.score is not None}


@dataclass(frozen=True)
class Trial(Generic[Fit]):
    """A model with one effect more, and its score."""

    fit: Fit
    score: Score


class Model(Protocol[Fit, Look]):
    """A family of models; `Fit` is one that was fitted, `Look` what it shows of what the candidates would explain."""

    def promise(self, current: Fit, barred: Collection[str]) -> Look:
        """What each candidate that is not barred would explain of what `current` leaves."""

    def hopeful(
        self, look: Look, tried: Mapping[str, Trial[Fit]], refused: Collection[str], number: int
    ) -> Sequence[str]:
        """Whom to carry in round `number` (from 0) beside those that were tried in it and those refused, of which
        there is no model of the right signs; asked until it says nobody.
        """

    def fit(
        self, current: Fit, look: Look, names: Sequence[str], tried: Mapping[str, Trial[Fit]]
    ) -> Mapping[str, Fit | str]:
        """For each name the model that carries it beside what `current` does, or why there is none."""

    def score(self, current: Fit, look: Look, fits: Mapping[str, Fit]) -> Mapping[str, Score]:
        """How these models compare."""

    def coefficients(self, fit: Fit) -> Mapping[str, Mapping[str, Estimate]]:
        """By effect, all that a model carries."""

    def objection(self, current: Fit, name: str, trial: Trial[Fit]) -> str | None:
        """What the part of the record that has no vote says against taking `name`."""


class Reducible(Model[Fit, Look], Protocol[Fit, Look]):
    """A family whose models can lose an effect again."""

    def without(self, current: Fit, name: str) -> tuple[Fit, Score]:
        """The model less an effect, and the score of the one with it over that."""

    def settled(self, current: Fit, names: Sequence[str], newest: str) -> Fit:
        """The model with the parameters of these effects where they are best beside `newest` and all that it carries,
        where what it leaves is not small.
        """


class Dissent(Enum):
    """What follows an objection to the best: the search ends; the next best of the round is asked; the round is made
    again without it; or it is taken all the same, and at the end the way is cut before the first that is objected to.
    """

    ENDS = "ends"
    NEXT = "next"
    AGAIN = "again"
    CUTS = "cuts"


@dataclass(frozen=True)
class Rules:
    """most: effects that are taken at most; dissent; signs: whether a coefficient that is declared positive may not be
    negative beyond doubt; anew: whether one that was is tried again in the next round, beside what was taken; near: the
    share of a gain from which on one that was beaten is asked again (`reconsidered`), None where nobody is; last: what
    is believed only if nothing else accounts for it, so that beside what was found later all are asked again; simpler:
    of those that were carried in a round, a simpler effect that the best is for all that the record tells, which is
    taken instead, None where there is none; nested: of those that a look promises something of, the effect that another
    is at an end of its range, where it may go beside those taken later.
    """

    most: int
    dissent: Dissent
    signs: bool = True
    anew: bool = False
    near: float | None = None
    last: Callable[[str], bool] = lambda name: False
    simpler: Callable[[str, Mapping[str, Trial[Any]]], str | None] = lambda best, trials: None
    nested: Callable[[str, Any], str | None] = lambda name, look: None


@dataclass(frozen=True)
class Step(Generic[Fit]):
    """An effect that was taken, with the model that carries it and its score, the model before, and the others that
    were carried in the round.
    """

    name: str
    trial: Trial[Fit]
    before: Fit
    beside: Mapping[str, Trial[Fit]]


def as_near(rounds: Sequence[Round[Look]]) -> dict[str, frozenset[str]]:
    """Of each effect that was taken, those carried beside it whose likelihood, price included, is not so much less that
    the record would tell them apart (`TIE`), however little their signatures were alike where the search stood; less
    those that the part without a vote objects to.
    """
    found: dict[str, frozenset[str]] = {}
    for one in rounds:
        scores = {each.name: each.score for each in one.tried if each.outcome is not Outcome.OBJECTED}
        if one.taken is not None and (taken := scores[one.taken]) is not None:
            found[one.taken] = frozenset(
                name
                for name, score in scores.items()
                if name != one.taken and score is not None and taken.standing - score.standing < TIE
            )
    return found


@dataclass(frozen=True)
class Chosen(Generic[Fit, Look]):
    """The way to the model.

    steps: in the order in which they were taken; rounds: every one, the last with what is seen behind the last step;
    barred: who was excluded for good, and why; more: there are as many as may be, and others still promise something;
    gains: what each that is kept gained, after pruning what taking it out loses; fit: the model with those; first: the
    step that was made first, as it was made.
    """

    steps: tuple[Step[Fit], ...]
    rounds: tuple[Round[Look], ...]
    barred: Mapping[str, str]
    more: bool
    gains: Mapping[str, float]
    fit: Fit
    first: Step[Fit] | None = None


def choose(
    model: Model[Fit, Look],
    start: Fit,
    rules: Rules,
    progress: Callable[[int, int], None] = lambda done, most: None,
    reducible: Reducible[Fit, Look] | None = None,
    begun: tuple[Step[Fit], Round[Look]] | None = None,
) -> Chosen[Fit, Look]:
    """Add effects to `start`, as many as are worth their price and `rules` allow; progress: rounds done, at most;
    reducible: the family, where what was taken is reconsidered; begun: a first step that is made anyhow, and its round.
    """
    steps: list[Step[Fit]] = []
    rounds: list[Round[Look]] = []
    barred: dict[str, str] = {}
    current, first = start, None
    if begun is not None:
        first, rounds = begun[0], [begun[1]]
        current, steps, rounds = _taken(reducible, first, steps, rounds, rules, barred)
    progress(len(rounds), rules.most)
    while True:
        look = model.promise(current, barred)
        if len(steps) == rules.most or not model.hopeful(look, {}, (), len(steps)):
            rounds.append(Round(look, (), None))
            break
        verdicts, trials = _carried(model, current, look, len(steps), rules, barred)
        taken, again = _best(model, current, trials, rules, verdicts, barred)
        rounds.append(Round(look, _tried(model, trials, verdicts), taken))
        progress(min(len(rounds), rules.most), rules.most)
        if taken is not None:
            step = Step(taken, trials[taken], current, {name: trial for name, trial in trials.items() if name != taken})
            first = first or step
            current, steps, rounds = _taken(reducible, step, steps, rounds, rules, barred)
        elif not again:
            break
    more = len(steps) == rules.most and bool(model.hopeful(rounds[-1].look, {}, (), len(steps)))
    if rules.dissent is Dissent.CUTS:
        steps, rounds = _cut(model, steps, rounds)
        current = steps[-1].trial.fit if steps else start
    gains = {step.name: step.trial.score.gain for step in steps}
    return Chosen(tuple(steps), tuple(rounds), barred, more, gains, current, first)


def _taken(
    reducible: Reducible[Fit, Look] | None,
    step: Step[Fit],
    steps: list[Step[Fit]],
    rounds: list[Round[Look]],
    rules: Rules,
    barred: dict[str, str],
) -> tuple[Fit, list[Step[Fit]], list[Round[Look]]]:
    """What is carried, the steps and the rounds with a step more; what was taken before it is reconsidered."""
    if reducible is None:
        return step.trial.fit, [*steps, step], rounds
    fit = reducible.settled(step.trial.fit, [one.name for one in steps], step.name)
    steps = [*steps, replace(step, trial=replace(step.trial, fit=fit))]
    return reconsidered(reducible, fit, steps, rounds, rules, barred)


def reconsidered(
    model: Reducible[Fit, Look],
    current: Fit,
    steps: list[Step[Fit]],
    rounds: list[Round[Look]],
    rules: Rules,
    barred: dict[str, str],
) -> tuple[Fit, list[Step[Fit]], list[Round[Look]]]:
    """What was taken before the last, each once more beside all that is carried now: one that has become superfluous
    goes for good, and one that came near it then takes its place where it is the better account by more than `TIE`;
    whoever it was, where the step is the last to be believed.  Beside one that took a place all others are asked again.

    An effect that is chosen while another is missing has to draw some of that one, too (Miller, Subset Selection in
    Regression, 2002, ch. 3: Efroymson's algorithm and sequential replacement).
    """
    newest = steps[-1].name
    waiting = steps[:-1]
    while waiting:
        step, *waiting = waiting
        less, kept = model.without(current, step.name)
        at = next(number for number, one in enumerate(rounds) if one.taken == step.name)
        others = [one for one in steps if one is not step]
        if kept.gain < kept.bar:
            barred[step.name] = f"superfluous beside {newest.replace('_', ' ')}"
            lost = {step.name: (Outcome.SUPERFLUOUS, barred[step.name])}
            current, steps = less, others
            rounds = [*rounds[:at], _untaken(rounds[at], lost), *rounds[at + 1 :]]
            continue
        holder = Trial(current, kept)
        trials = _near(model, less, rounds[at].look, step, holder, {one.name for one in steps}, rules)
        if not trials:
            continue
        everyone = {**trials, step.name: holder}
        best = plainest(everyone, rules)
        better = everyone[best].score.standing > kept.standing + TIE
        if not better or model.objection(less, best, trials[best]) is not None:
            continue
        beside = {name: trial for name, trial in trials.items() if name != best} | {step.name: holder}
        current, steps = trials[best].fit, [*others, Step(best, trials[best], less, beside)]
        rounds = [*rounds[:at], exchanged(rounds[at], best), *rounds[at + 1 :]]
        newest, waiting = best, others
    return current, steps, rounds


def _near(
    model: Reducible[Fit, Look],
    less: Fit,
    look: Look,
    step: Step[Fit],
    holder: Trial[Fit],
    known: Collection[str],
    rules: Rules,
) -> dict[str, Trial[Fit]]:
    """Beside `less`, those that came near a step when it was taken, or all where it is the last to be believed, and
    what it may have turned into, as far as there is a model of the right signs; holder: the step beside `less`, whose
    place it is.
    """
    share = math.inf if rules.near is None else 0.0 if rules.last(step.name) else rules.near
    enough = share * step.trial.score.gain
    names = [name for name, one in step.beside.items() if one.score.gain > enough and name not in known]
    simpler = rules.nested(step.name, look)
    if simpler is not None and simpler not in (*names, *known):
        names.append(simpler)
    fits = {
        name: found
        for name, found in (model.fit(less, look, names, {step.name: holder}) if names else {}).items()
        if not isinstance(found, str) and not (rules.signs and unphysical(model.coefficients(found)))
    }
    scores = model.score(less, look, fits) if fits else {}
    return {name: Trial(fits[name], scores[name]) for name in fits}


def exchanged(one: Round[Look], best: str) -> Round[Look]:
    """The round as if `best`, which was carried in it, had been taken, and the one that was had been beaten."""
    why = {best: (Outcome.TAKEN, ""), one.taken: _BEATEN}
    tried = (
        replace(each, outcome=why[each.name][0], reason=why[each.name][1]) if each.name in why else each
        for each in one.tried
    )
    return replace(one, tried=tuple(tried), taken=best)


def unphysical(coefficients: Mapping[str, Mapping[str, Estimate]]) -> str | None:
    """In words, a coefficient that came out negative beyond doubt though it is declared positive, and is no trifle
    beside the largest of its effect that is there beyond doubt: where one axis has an effect and the other none, chance
    makes one of those.  Or a gain of the other sign that is none of a channel the other way round: a device that is
    driven by less than nothing.
    """
    for effect in coefficients.values():
        there = [estimate.value for estimate in effect.values() if estimate.positive and estimate.low > 0.0]
        largest = max(there, default=0.0)
        for name, estimate in effect.items():
            if estimate.positive and estimate.high < 0.0 and -estimate.value > _TRIFLE * largest:
                return f"a negative {name}"
            if estimate.gain and estimate.high < -1.0 and not estimate.is_polarity:
                return f"{name} = {estimate.value:.3g}, a gain of the other sign"
    return None


def tried_reason(tried: Tried, taken: str | None) -> str:
    """Why a candidate that was carried was not taken, with what it gained; taken: who was."""
    if tried.score is None:
        return tried.reason
    if tried.outcome is Outcome.TOO_DEAR and tried.score.gain < -tried.score.bar:
        lost = -tried.score.gain
        how = f"loses {significant(lost)} in twice the log-likelihood" if math.isfinite(lost) else "diverges"
        return f"the model with it {how}: the search did not reach its coefficients, which says nothing against it"
    if tried.outcome is Outcome.TOO_DEAR:
        return f"{gained(tried.score.gain)}: no more than chance"
    if tried.outcome is Outcome.BEATEN:
        return f"{gained(tried.score.gain)}; {(taken or 'another').replace('_', ' ')} explains more for its price"
    return f"{gained(tried.score.gain)}; {tried.reason}"


def why_not(rounds: Sequence[Round[Look]], meant: Callable[[str], bool]) -> str | None:
    """Why a candidate was not taken, by the last round that carried it; None where none did."""
    last = last_carried(rounds, meant)
    return None if last is None else tried_reason(*last)


def last_carried(rounds: Sequence[Round[Look]], meant: Callable[[str], bool]) -> tuple[Tried, str | None] | None:
    """What became of a candidate in the last round that carried it and took another, and who was taken there; None
    where none did.
    """
    tried = ((each, one.taken) for one in reversed(rounds) for each in one.tried if each.name != one.taken)
    return next((last for last in tried if meant(last[0].name)), None)


def leaves_the_rest(gain: float) -> str:
    """Why an effect with such a gain explains nothing by itself."""
    return f"{gained(gain)} and leaves the rest"


def gained(gain: float) -> str:
    """A gain in words."""
    return f"carried, it gains {significant(gain)} in twice the log-likelihood"


_Verdicts = dict[str, tuple[Outcome, str]]
_BEATEN = (Outcome.BEATEN, "another explains more for its price")


def _carried(
    model: Model[Fit, Look], current: Fit, look: Look, number: int, rules: Rules, barred: dict[str, str]
) -> tuple[_Verdicts, dict[str, Trial[Fit]]]:
    """Carry the hopeful: a trial for each that has a model of the right signs; the others are barred.  One of a wrong
    sign is among the trials where it outweighs all of these: it has drawn some of another that is missing.
    """
    verdicts: _Verdicts = {}
    trials: dict[str, Trial[Fit]] = {}
    unlawful: dict[str, Fit] = {}
    while names := [
        name for name in model.hopeful(look, trials, verdicts.keys() - trials.keys(), number) if name not in verdicts
    ]:
        fits: dict[str, Fit] = {}
        for name, found in model.fit(current, look, names, trials).items():
            if isinstance(found, str):
                verdicts[name] = Outcome.IMPOSSIBLE, found
                barred[name] = found
            elif rules.signs and (wrong := unphysical(model.coefficients(found))):
                why = f"fits only with {wrong}, which would be something else"
                verdicts[name] = Outcome.UNPHYSICAL, why
                if rules.anew:
                    unlawful[name] = found
                else:
                    barred[name] = why
            else:
                verdicts[name] = _BEATEN
                fits[name] = found
        if fits:
            scores = model.score(current, look, fits)
            trials |= {name: Trial(fits[name], scores[name]) for name in fits}
    if unlawful and (most := _outweighing(model.score(current, look, unlawful), trials)):
        name, score = most
        trials[name] = Trial(unlawful[name], score)
        verdicts[name] = _BEATEN
    return verdicts, trials


def _outweighing(unlawful: Mapping[str, Score], trials: Mapping[str, Trial[Fit]]) -> tuple[str, Score] | None:
    """The best of those of a wrong sign, if the best of the others gains far less."""
    best = max(unlawful, key=lambda name: unlawful[name].standing)
    most = max((trial.score.gain for trial in trials.values()), default=0.0)
    return (best, unlawful[best]) if most < OUTWEIGHED * unlawful[best].gain else None


def leader(trials: Mapping[str, Trial[Fit]]) -> str:
    """The best of these: the largest likelihood less price, of equals the simpler."""
    return ranked(trials)[0]


def ranked(trials: Mapping[str, Trial[Fit]]) -> list[str]:
    """By likelihood less price, the largest first, of equals the simpler."""
    return sorted(trials, key=lambda name: (-trials[name].score.standing, trials[name].score.price))


def plainest(trials: Mapping[str, Trial[Fit]], rules: Rules) -> str:
    """The best of these, or the simpler effect that it is for all that the record tells."""
    best = leader(trials)
    return rules.simpler(best, trials) or best


def _best(
    model: Model[Fit, Look],
    current: Fit,
    trials: Mapping[str, Trial[Fit]],
    rules: Rules,
    verdicts: _Verdicts,
    barred: dict[str, str],
) -> tuple[str | None, bool]:
    """Who is taken, and whether the round is to be made again; `verdicts` and `barred` learn why not."""
    for name, trial in trials.items():
        if not trial.score.gain > trial.score.bar:
            why = f"gains {significant(trial.score.gain)}, and {significant(trial.score.bar)} would be needed"
            verdicts[name] = Outcome.TOO_DEAR, why
    names = _lawful_first(model, trials)
    if (simpler := _simpler(names, trials, rules)) is not None:
        why = f"the record does not tell it from {simpler.replace('_', ' ')}, which is simpler"
        verdicts[names[0]] = Outcome.NESTED, why
        names = [simpler, *(name for name in names if name != simpler)]
    for name in names:
        if verdicts[name][0] is Outcome.TOO_DEAR:
            if rules.dissent is Dissent.NEXT:
                continue
            return None, False
        objection = None if rules.dissent is Dissent.CUTS else model.objection(current, name, trials[name])
        if objection is None:
            verdicts[name] = Outcome.TAKEN, ""
            return name, False
        verdicts[name] = Outcome.OBJECTED, objection
        if rules.dissent is Dissent.ENDS:
            return None, False
        barred[name] = objection
        if rules.dissent is Dissent.AGAIN:
            return None, True
    return None, False


def _simpler(names: Sequence[str], trials: Mapping[str, Trial[Fit]], rules: Rules) -> str | None:
    """The simpler effect that the first of these may be; None where there is none, or it is not worth its price."""
    found = rules.simpler(names[0], trials) if names else None
    return found if found is not None and trials[found].score.gain > trials[found].score.bar else None


def _lawful_first(model: Model[Fit, Look], trials: Mapping[str, Trial[Fit]]) -> list[str]:
    """By likelihood less price; where the best has a coefficient of the wrong sign, one that the record does not tell
    from it and that has none goes before.
    """
    names = ranked(trials)

    def lawful(name: str) -> bool:
        return unphysical({name: model.coefficients(trials[name].fit).get(name, {})}) is None

    if not names or lawful(names[0]):
        return names
    enough = trials[names[0]].score.standing - TIE
    for name in names[1:]:
        if not trials[name].score.standing > enough:
            break
        if lawful(name):
            return [name, *(other for other in names if other != name)]
    return names


def _tried(model: Model[Fit, Look], trials: Mapping[str, Trial[Fit]], verdicts: _Verdicts) -> tuple[Tried, ...]:
    tried = []
    for name, (outcome, reason) in verdicts.items():
        trial = trials.get(name)
        coefficients = {} if trial is None else model.coefficients(trial.fit)[name]
        tried.append(Tried(name, outcome, reason, None if trial is None else trial.score, coefficients))
    return tuple(tried)


def _cut(
    model: Model[Fit, Look], steps: list[Step[Fit]], rounds: list[Round[Look]]
) -> tuple[list[Step[Fit]], list[Round[Look]]]:
    """The way up to the first step that is objected to; the rounds say of it and of those that follow why they went."""
    for at, step in enumerate(steps):
        objection = model.objection(step.before, step.name, step.trial)
        if objection is None:
            continue
        lost = {later.name: (Outcome.AFTER, f"follows {step.name}, which {objection}") for later in steps[at:]}
        lost[step.name] = Outcome.OBJECTED, objection
        return steps[:at], [*rounds[:at], *(_untaken(one, lost) for one in rounds[at:])]
    return steps, rounds


def _untaken(one: Round[Look], lost: Mapping[str, tuple[Outcome, str]]) -> Round[Look]:
    tried = tuple(
        replace(each, outcome=lost[each.name][0], reason=lost[each.name][1]) if each.name == one.taken else each
        for each in one.tried
    )
    return replace(one, tried=tried, taken=None)
