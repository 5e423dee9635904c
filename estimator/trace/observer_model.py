"""Models of two axes: the bench's observer, with what it carries, over the record; compared by their innovations."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.effects.search import Search
from estimator.settings import Device
from estimator.side_by_side import side_by_side
from estimator.thresholds import THRESHOLDS
from estimator.trace.candidates import kind, of_resonance_alone, searched_by
from estimator.trace.certainty import TWO_SIDED, covariance_of, interval_of
from estimator.trace.criterion import TIE, chance_gain, schwarz
from estimator.trace.engine import Estimate, Score, Trial, leader, unphysical
from estimator.trace.fitting import Fitted, coefficients_of, finished, fit, foresight, leads, parameters_of, widening
from estimator.trace.look import Look, look_at
from estimator.trace.nested import turned_into
from estimator.trace.parameters import refine_apart, refine_in_turn, refine_parameters
from estimator.trace.problem import Problem
from estimator.trace.same_number import same_numbers, surer
from estimator.trace.screening import spoken_for
from estimator.trace.searched import NOTHING, Searched
from estimator.trace.width import hopeful, worth_finishing, worth_following, worth_refining

_SET = THRESHOLDS.choice


@dataclass(frozen=True, eq=False)
class Carrying:
    """A model that was fitted to the record of `problem`, and how surely the parameters of what it carries were found,
    by effect; less: what `ObserverModel.without` made of it, since it is asked again when all have been taken.
    """

    problem: Problem
    fitted: Fitted
    searched: Mapping[str, Searched] = field(default_factory=dict)
    less: dict[str, "tuple[Carrying, Score]"] = field(default_factory=dict, repr=False)

    @cached_property
    def look(self) -> Look:
        """What candidates would explain of what it leaves."""
        return look_at(self.problem, self.fitted)


@dataclass(frozen=True)
class ObserverModel:
    """`estimator.trace.engine.Model` of the bench's observer on the record on which candidates are compared; progress:
    told of every candidate, since a round of them may take minutes.
    """

    problem: Problem
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None

    def promise(self, current: Carrying, barred: Collection[str]) -> Look:
        """A scan; those that are barred are watched and have no evidence."""
        look = current.look
        left = {name: item for name, item in look.evidence.items() if name not in barred}
        return replace(look, evidence=left) if barred else look

    def hopeful(
        self, look: Look, tried: Mapping[str, Trial[Carrying]], refused: Collection[str], number: int
    ) -> Sequence[str]:
        """The leaders of the scan and whoever may be no worse; all kinds, where the best of them leaves something."""

        def behind() -> Look:
            return tried[leader(tried)].fit.look

        def screened(names: list[str], spared: Collection[str]) -> list[str]:
            best = leader(tried)
            effects = tried[best].fit.fitted.settings.effects
            beside = {name: given for name, given in effects.items() if name != best}
            return spoken_for(
                self.problem,
                effects,
                beside,
                {name: {**beside, name: look.watched[name]} for name in names},
                spared,
                tried[best].score.gain,
                self.progress,
            )

        gains = {name: trial.score.gain for name, trial in tried.items()}
        return hopeful(look, gains, refused, behind, screened, calm=_is_calm(self.problem))

    def fit(
        self, current: Carrying, look: Look, names: Sequence[str], tried: Mapping[str, Trial[Carrying]]
    ) -> Mapping[str, Carrying | str]:
        """Each beside what `current` carries, those that one pass leaves far behind by that pass; parameters of those
        near the best are searched, and those with the same parameters follow them.  One that loses, though it may be
        nothing, was linearised about the wrong place and begins again with the coefficients of the scan.  What turns
        into a simpler effect on the way is none.
        """
        base = current.fitted
        effects = coefficients_of(base.observer)
        carried = side_by_side(
            [partial(fit, self.problem.carrying({**effects, name: look.watched[name]}), again=False) for name in names],
            lambda done: self.progress("candidates", done, len(names)),
        )
        models = dict(zip(names, carried, strict=True))
        lost = [name for name in names if not models[name].likelihood > base.likelihood and name in look.evidence]
        begun = [{**effects, name: self._as_scanned(look, name)} for name in lost]
        again = side_by_side(
            [partial(fit, self.problem.carrying(carrying)) for carrying in begun],
            lambda done: self.progress("candidates begun again", done, len(lost)),
        )
        for name, model in zip(lost, again, strict=True):
            models[name] = max(models[name], model, key=lambda fitted: fitted.likelihood)
        searched: dict[str, Searched] = {}
        reached = tried[leader(tried)].score.gain if tried else -np.inf
        gains = {name: trial.score.gain for name, trial in tried.items()}
        going_on = worth_finishing(models, base, gains)
        ends = side_by_side([partial(finished, self.problem, models[name]) for name in going_on])
        models |= dict(zip(going_on, ends, strict=True))
        near = worth_refining(models, base, gains, look.watched)
        near = [name for name in near if not self._is_reversed(models[name], name)]
        seen = {name: trial.fit.fitted for name, trial in tried.items()} | models
        models |= {name: self._between(current, seen, name) for name in near}
        following = worth_following(models, base, gains, look.watched, near)
        for done, name in enumerate(near, 1):
            best = max(base.likelihood + reached, *(fitted.likelihood for fitted in models.values()))
            models[name], searched[name] = refine_parameters(self.problem, models[name], name, to_beat=best)
            self.progress("parameters", done, len(near))
        found_there = [
            partial(fit, self.problem.carrying({**effects, name: parameters_of(models[other], other)}))
            for name, other in following.items()
        ]
        for (name, other), there in zip(following.items(), side_by_side(found_there), strict=True):
            if there.likelihood > models[name].likelihood:
                known = searched[other]
                models[name] = there
                searched[name] = replace(known, moves=np.zeros((self._degrees(name), len(known.names))))
        found: dict[str, Carrying | str] = {}
        for name, fitted in models.items():
            if simpler := turned_into(self.problem, name, parameters_of(fitted, name)):
                found[name] = f"its parameters go where it is {simpler}"
            else:
                found[name] = Carrying(self.problem, fitted, {**current.searched, name: searched.get(name, NOTHING)})
        return found

    def _as_scanned(self, look: Look, name: str) -> dict[str, float]:
        """An effect with the coefficients that the scan has of it."""
        _, effect = effect_for(name, self.problem.device.axes, self.problem.device.own)
        symbols = [c.name.partition(":")[0] for c in effect.coefficients]
        return {**look.watched[name], **dict(zip(symbols, look.evidence[name].coefficients.tolist(), strict=True))}

    def _between(self, current: Carrying, models: Mapping[str, Fitted], name: str) -> Fitted:
        """The model of `name`, or, where that is the likelier, one halfway between its parameter and that of the next
        of its kind, by the geometric mean: a search may come from neither to a top that lies between them.
        """
        mine = models[name]
        others = [other for other in models if other != name and kind(other) == kind(name)]
        parameters = parameters_of(mine, name)
        if not others or len(parameters) != 1 or "omega" in parameters:
            return mine
        next_best = max(others, key=lambda other: models[other].likelihood)
        theirs = parameters_of(models[next_best], next_best)
        middle = {which: math.sqrt(value * theirs[which]) for which, value in parameters.items()}
        effects = {**coefficients_of(current.fitted.observer), name: middle}
        return max(mine, fit(self.problem.carrying(effects)), key=lambda fitted: fitted.likelihood)

    def score(self, current: Carrying, look: Look, fits: Mapping[str, Carrying]) -> Mapping[str, Score]:
        """Each number that an effect has is paid for: a drive that saturates at nothing is one of another gain, with a
        limit too many.  The gain must be more than chance gives the best of all candidates.
        """
        base = current.fitted
        samples = base.estimates.innovation.size
        return {
            name: Score(
                likelihood=carrying.fitted.likelihood,
                gain=carrying.fitted.likelihood - base.likelihood,
                price=schwarz(self._numbers(name), samples),
                bar=chance_gain(self._degrees(name), len(look.evidence)),
            )
            for name, carrying in fits.items()
        }

    def coefficients(self, fit: Carrying) -> Mapping[str, Mapping[str, Estimate]]:
        """With the intervals of the observer, widened by its innovations."""
        return estimates_of(fit.fitted, fit.searched)

    def objection(self, current: Carrying, name: str, trial: Trial[Carrying]) -> str | None:
        """What was found on the first part of the record must predict the rest."""
        if carries_over(self.problem, current.fitted, trial.fit.fitted, name):
            return None
        return "found on the first part of the record, it does not predict the rest better"

    def without(self, current: Carrying, name: str) -> tuple[Carrying, Score]:
        """Of one pass about what was found; what is lost must be more than chance gives."""
        if name not in current.less:
            current.less[name] = self._without(current, name)
        return current.less[name]

    def settled(self, current: Carrying, names: Sequence[str], newest: str) -> Carrying:
        """A limit that was found while another effect was missing is not where it is best beside that one; what it
        leaves there would be taken for a third.  A corner that no coefficient tells, since that stands for the phase of
        what is still missing, is looked for by itself.
        """
        if widening(current.fitted) ** 2 < 1.0 + THRESHOLDS.width.power:
            return current
        found = [name for name in names if name in current.searched and current.searched[name].names]
        fitted, searched = refine_in_turn(self.problem, current.fitted, current.searched, found)
        for name in (*names, newest):
            if name not in found and not searched.get(name, NOTHING).names:
                fitted, searched[name] = refine_apart(self.problem, fitted, name)
        return replace(current, fitted=fitted, searched=searched, less={})

    def _without(self, current: Carrying, name: str) -> tuple[Carrying, Score]:
        model = current.fitted
        rest = {other: given for other, given in coefficients_of(model.observer).items() if other != name}
        less = fit(self.problem.under(model.settings).carrying(rest), passes=1)
        price = schwarz(self._numbers(name), model.estimates.innovation.size)
        loss = model.likelihood - less.likelihood
        score = Score(model.likelihood, loss, price, chance_gain(self._degrees(name), _SET.rivals))
        searched = {other: found for other, found in current.searched.items() if other != name}
        return Carrying(self.problem, less, searched), score

    def _is_reversed(self, model: Fitted, name: str) -> bool:
        """Whether an effect comes out of the wrong sign that has a parameter which is the same number as a coefficient.

        Such a parameter says by how much a filter turns the phase of a vibration, which is between nothing and a
        quarter turn wherever its corner lies: no search for the corner makes a lead of a lag.
        """
        _, effect = effect_for(name, self.problem.device.axes, self.problem.device.own)
        return bool(same_numbers(effect)) and unphysical({name: estimates_of(model, {})[name]}) is not None

    def _degrees(self, name: str) -> int:
        return degrees(name, self.problem.device)

    def _numbers(self, name: str) -> int:
        return numbers(name, self.problem.device)


def estimates_of(model: Fitted, searched: Mapping[str, Searched]) -> Mapping[str, Mapping[str, Estimate]]:
    """The coefficients of all that a model carries, with the intervals of its observer, widened by its innovations."""
    found = {}
    for name, given in coefficients_of(model.observer).items():
        _, effect = effect_for(name, model.observer.device.axes, model.observer.device.own)
        found_by = searched.get(name, NOTHING)
        with np.errstate(invalid="ignore"):
            covariance = covariance_of(name, model, found_by)
            half = TWO_SIDED * np.sqrt(np.diagonal(covariance))
        own = {}
        for c, off in zip(effect.coefficients, half.tolist(), strict=True):
            symbol = c.name.partition(":")[0]
            own[symbol] = Estimate(
                given[symbol], given[symbol] - off, given[symbol] + off, c.positive, gain=effect.gain
            )
        for symbol, parameter in surer(model.observer.device, model, name, found_by).items():
            low, high = interval_of(parameter, given[parameter], model, found_by)
            own[symbol] = replace(own[symbol], value=given[parameter], low=low, high=high)
        found[name] = own
    return found


def degrees(name: str, device: Device) -> int:
    """How many coefficients an effect has."""
    return len(effect_for(name, device.axes, device.own)[1].coefficients)


def numbers(name: str, device: Device) -> int:
    """How many coefficients it has that are paid for, and parameters that are none of them.

    Schwarz's price is that of a number of which the record tells the more the longer it is.  Of how what an effect adds
    begins and wanes, a few samples tell all, and the spread with which an observer begins has paid for it.
    """
    _, effect = effect_for(name, device.axes, device.own)
    return sum(not c.wanes for c in effect.coefficients) + sum(p.found_as is None for p in effect.parameters)


def told(name: str, problem: Problem) -> int:
    """Of its numbers, those that the record tells something of: not the frequency of a mode and its damping where the
    drive has one frequency.
    """
    device = problem.device
    return (degrees if searched_by(name) is Search.MODES and _is_calm(problem) else numbers)(name, device)


def _is_calm(problem: Problem) -> bool:
    return of_resonance_alone(problem.record, problem.device)


def carries_over(problem: Problem, base: Fitted, model: Fitted, *names: str) -> bool:
    """Whether the effects that `model` has beside what `base` carries, their coefficients found on the first part of
    the record, predict the rest better: by its share of the gain, or at least by more than chance would.

    Where the rest tells nothing even to who has seen it, as behind a start that alone shows the effect, it only must
    not be predicted worse.
    """
    seen = round(_SET.learnt * len(problem.record))
    effects = coefficients_of(base.observer)
    added = {name: parameters_of(model, name) for name in names}
    without, carried = side_by_side(
        [partial(foresight, problem.carrying({**effects, **more}), seen) for more in ({}, added)]
    )
    by_chance = chance_gain(sum(degrees(name, problem.device) for name in names), 1)
    by_part = leads(model, base)
    seen_there = float(np.sum(by_part[round(_SET.learnt * len(by_part)) :]))
    if seen_there < by_chance:
        return carried - without > -TIE
    share = (1.0 - _SET.learnt) * (model.likelihood - base.likelihood)
    return carried - without > min(_SET.borne_out * min(share, seen_there), by_chance)
