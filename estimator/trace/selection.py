"""Which effects the model lacks: one after another, each the one that explains most, as exactly as the model goes.

A scan of the record tells how much every effect of the catalogue would explain and who looks like whom; the few that
come into question are then carried by an observer each, and their likelihoods decide.  Each effect taken is carried
from then on, and the residual that is left is scanned again.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from scipy.stats import chi2

from estimator.effects.catalogue import effect_for
from estimator.settings import Device, Gain, ObserverSettings
from estimator.trace.candidates import Parameters, watch_list
from estimator.trace.evidence import Evidence, evidence, likeness
from estimator.trace.fitting import Fitted, coefficients_of, fit, foresight, parameters_of
from estimator.trace.parameters import NOTHING, Searched, refine_parameters
from estimator.trace.problem import Effects, Problem
from estimator.trace.scan import Scan, scan

MOST = 3
"""Effects that are named at most: with more the model is a patchwork, and none of them the cause."""

CHANCE = 1e-4  # of naming anything on a record to which nothing is to be added
_LOCKED = 0.03  # of the amplitude: an innovation larger than that makes the linear scan unsure
_SAME = 0.97  # likeness above which a candidate is tried for itself beside the best
_SERIOUS = 0.5  # of the best gain: a candidate with that much is tried as well
_NEAR = 0.9  # of the best gain: parameters are improved before the choice
_TRIED = 5
_LEFT = 0.01  # of the best gain: less is a matter for a second effect
_WIDER = 8  # tried beside, where the best does not explain everything
_LEARNT = 2.0 / 3.0  # of the record: what an effect explains of it must be borne out by the rest
_PROPORTION = 0.25
_APART = 30.0  # rad over the record: closer than that two frequencies are one
_COMPARED = 150_000  # samples on which candidates are compared


@dataclass(frozen=True)
class Look:
    """What is seen with a model: what was watched, what each candidate would explain, and which of them surely."""

    watched: Mapping[str, Parameters]
    seen: Scan
    evidence: dict[str, Evidence]

    @property
    def serious(self) -> list[Evidence]:
        """Those that chance does not account for, the best first."""
        return [item for item in self.evidence.values() if item.significance > threshold(len(self.evidence))]


@dataclass(frozen=True)
class Step:
    """One round of the selection: what was watched, what each candidate would explain, who was taken, who looks like
    it, and the gains of those that were tried.
    """

    watched: Mapping[str, Parameters]
    evidence: dict[str, Evidence]
    taken: str | None
    alike: dict[str, float]
    tried: dict[str, float]


@dataclass(frozen=True)
class Trials:
    """Models that carry one effect more than `base` each, by its name, and how surely its parameters were found."""

    base: Fitted
    models: Mapping[str, Fitted]
    searched: Mapping[str, Searched]

    @property
    def best(self) -> str:
        """Whose likelihood is largest, once each number it has is paid for (Schwarz, Annals of Statistics 6(2), 1978):
        a drive that saturates at nothing is one of another gain, with a limit too many.
        """
        return max(self.models, key=lambda name: self.models[name].likelihood - self._price(name))

    def _price(self, name: str) -> float:
        _, effect = effect_for(name, self.base.observer.device.axes)
        numbers = len(effect.coefficients) + len(effect.parameters)
        return numbers * float(np.log(self.base.estimates.innovation.size))

    @property
    def gains(self) -> dict[str, float]:
        """Twice the log-likelihood that each gains."""
        return {name: fitted.likelihood - self.base.likelihood for name, fitted in self.models.items()}

    def __or__(self, others: "Trials") -> "Trials":
        return Trials(self.base, {**self.models, **others.models}, {**self.searched, **others.searched})


@dataclass(frozen=True)
class Selection:
    """Effects in the order in which they were taken, with their coefficients; the rounds; models before and after;
    what each gained; how surely the parameters that were searched for are known; whether there are as many as may be
    and still something is left.
    """

    effects: Effects
    rounds: tuple[Step, ...]
    before: Fitted
    after: Fitted
    gain: Mapping[str, float]
    searched: Mapping[str, Searched]
    patchwork: bool

    @property
    def samples(self) -> int:
        """How many samples the models were fitted to."""
        return len(self.after.estimates.innovation)


Progress = Callable[[str, int, int], None]


def select(
    problem: Problem,
    progress: Progress,
) -> Selection:
    """Choose effects on the record of `problem`, the part to be fitted, beside those that it carries already."""
    search = Search(problem.part(slice(0, _COMPARED)))
    first = model = fit(search.problem)
    rounds: list[Step] = []
    gains: dict[str, float] = {}
    searched: dict[str, Searched] = {}
    progress("effects", 0, MOST)
    look = search.look(model)
    while look.serious and len(rounds) < MOST:
        trials = search.tried(model, look, shortlist(look.seen, look.serious))
        after = search.look(trials.models[trials.best])
        left = max((item.gain for item in after.serious), default=0.0)
        if not rounds and left > _LEFT * trials.gains[trials.best]:  # would another have explained that, too?
            usual = trials.best
            trials |= search.tried(model, look, second_thoughts(look.evidence, trials.models), trials.gains[usual])
            after = after if trials.best == usual else search.look(trials.models[trials.best])
        best, gain = trials.best, trials.gains[trials.best]
        sure = gain > surprise(search.degrees(best), len(look.evidence)) and search.carries_over(trials, best)
        taken = best if sure else None
        rounds.append(Step(look.watched, look.evidence, taken, likeness(look.seen, best), trials.gains))
        progress("effects", len(rounds), MOST)
        if not sure:
            break
        gains[best], searched = gain, {**searched, best: trials.searched.get(best, NOTHING)}
        model, look = trials.models[best], after
    else:
        rounds.append(Step(look.watched, look.evidence, None, {}, {}))
    patchwork = len(gains) == MOST and bool(look.serious)
    effects: Effects = coefficients_of(model.observer)
    if not patchwork:
        effects, gains = prune(search.problem, model, gains)
    whole = len(problem.record) > len(search.problem.record)
    before = fit(problem) if whole else first
    last = (
        fit(problem.under(model.settings).carrying(effects))
        if whole or len(effects) < len(model.observer.effects)
        else model
    )
    if not patchwork and (whole or len(gains) > 1):
        for name in gains:  # what a parameter should be depends on the record and on what else is carried
            last, searched[name] = refine_parameters(problem, last, name, before=searched[name])
    return Selection(coefficients_of(last.observer), tuple(rounds), before, last, gains, searched, patchwork)


@dataclass(frozen=True)
class Search:
    """The bench's observer on the record on which candidates are compared."""

    problem: Problem

    def look(self, model: Fitted) -> Look:
        """Scan what the model leaves: once to see its lines, once with all that may explain it."""
        problem = self.problem.under(scanned_with(model, self.problem.device, self.problem.settings))
        base = scan(problem, {}, model.observer)
        everything = watch_list(problem.record, problem.device, base.innovation, base.deviation)
        watched = fresh(everything, model.settings.effects, problem.span)
        seen = scan(problem, watched, model.observer)
        return Look(watched, seen, evidence(seen))

    def tried(self, base: Fitted, look: Look, names: list[str], reached: float = -np.inf) -> Trials:
        """Models with each of these beside what `base` carries; parameters of those near the best are searched.

        reached: the gain of the best that was tried before.
        """
        effects = coefficients_of(base.observer)
        models = {name: fit(self.problem.carrying({**effects, name: look.watched[name]})) for name in names}
        searched: dict[str, Searched] = {}
        for name in worth_refining(models, base, reached, look.watched):
            best = max(base.likelihood + reached, *(fitted.likelihood for fitted in models.values()))
            models[name], searched[name] = refine_parameters(self.problem, models[name], name, to_beat=best)
        return Trials(base, models, searched)

    def carries_over(self, trials: Trials, name: str) -> bool:
        """Whether the effect, its coefficients found on the first part of the record, predicts the rest better: by its
        share of the gain, or at least by more than chance would.
        """
        seen = round(_LEARNT * len(self.problem.record))
        effects = coefficients_of(trials.base.observer)
        added = {name: parameters_of(trials.models[name], name)}
        without, carried = (foresight(self.problem.carrying({**effects, **more}), seen) for more in ({}, added))
        share = _PROPORTION * (1.0 - _LEARNT) * trials.gains[name]
        return carried - without > min(share, surprise(self.degrees(name), 1))

    def degrees(self, name: str) -> int:
        """How many coefficients an effect has."""
        return len(effect_for(name, self.problem.device.axes)[1].coefficients)


def kind(name: str) -> str:
    """Name of an effect without its label."""
    return name.partition(":")[0]


def threshold(candidates: int) -> float:
    """Significance (log10 of a probability) that chance reaches for none of so many candidates."""
    return float(-np.log10(CHANCE / max(candidates, 1)))


def surprise(degrees: int, candidates: int) -> float:
    """Gain of twice the log-likelihood that chance gives the best of so many candidates."""
    return float(chi2.isf(CHANCE / max(candidates, 1), degrees))


def fresh(watched: Mapping[str, Parameters], effects: Effects, span: float) -> dict[str, Parameters]:
    """What is watched and not carried: a line or a mode may come again at another frequency, everything else is there
    once.  span: length of the record in s, which tells frequencies apart.
    """
    carried = {kind(name) for name in effects}
    frequencies = [given["omega"] for given in effects.values() if "omega" in given]

    def is_new(name: str, given: Parameters) -> bool:
        if "omega" not in given:
            return kind(name) not in carried
        return all(abs(given["omega"] - other) > _APART / span for other in frequencies)

    new = {name: given for name, given in watched.items() if is_new(name, given)}
    return {_relabelled(name, effects, watched): given for name, given in new.items()}


def _relabelled(name: str, effects: Effects, watched: Mapping[str, Parameters]) -> str:
    """The name, with a label that neither what is carried nor what is watched has yet where it is carried."""
    if name not in effects:
        return name
    return next(free for n in count(1) if (free := f"{kind(name)}:{n}") not in effects and free not in watched)


def scanned_with(model: Fitted, device: Device, settings: ObserverSettings) -> ObserverSettings:
    """The model as it is to be scanned: without forgetting where it is nearly right, with the memory of the bench where
    the motion would get away from it.
    """
    amplitude = np.abs(device.sense_gain) * device.amplitude
    lost = float(np.sqrt(np.nanmean((model.estimates.innovation / amplitude) ** 2)))
    if lost < _LOCKED:
        return replace(model.settings, gain=Gain.EKF)
    return replace(settings, gain=Gain.FADING, effects=coefficients_of(model.observer))


def shortlist(seen: Scan, serious: list[Evidence]) -> list[str]:
    """Those to be tried: the best, what looks like it, what explains much by itself and steadily."""
    best = serious[0]
    alike = likeness(seen, best.name)
    steady = sorted(serious, key=lambda item: -item.gain / max(item.scatter, 1.0))
    names = [best.name]
    for item in (*steady[:2], *serious[1:]):
        if item.name in names:
            continue
        if item in steady[:2] or alike[item.name] > _SAME or item.gain > _SERIOUS * best.gain:
            names.append(item.name)
    return names[:_TRIED]


def second_thoughts(found: Mapping[str, Evidence], tried: Mapping[str, Fitted]) -> list[str]:
    """The best of each kind that was not tried, sure or not: far from the truth, the scan is a rough guide."""
    names: list[str] = []
    for item in found.values():
        if all(kind(item.name) != kind(name) for name in (*names, *tried)):
            names.append(item.name)
    return names[:_WIDER]


def worth_refining(
    models: Mapping[str, Fitted], base: Fitted, reached: float, watched: Mapping[str, Parameters]
) -> list[str]:
    """Of those that come near the best, the ones with parameters; of two of a kind, or with the same parameters, the
    better.
    """
    leading = max(reached, *(fitted.likelihood - base.likelihood for fitted in models.values()))
    near = [name for name, fitted in models.items() if fitted.likelihood - base.likelihood > _NEAR * leading]
    near.sort(key=lambda name: -models[name].likelihood)
    taken: list[str] = []
    for name in near:
        if watched[name] and all(watched[name] != watched[other] and kind(name) != kind(other) for other in taken):
            taken.append(name)
    return taken


def prune(problem: Problem, model: Fitted, gains: dict[str, float]) -> tuple[Effects, dict[str, float]]:
    """Take out again what the later effects have made superfluous."""
    effects = coefficients_of(model.observer)
    for name in list(gains):
        if len(effects) - len(problem.effects) < 2:
            break
        rest = {other: given for other, given in effects.items() if other != name}
        without = fit(problem.under(model.settings).carrying(rest), passes=1)
        loss = model.likelihood - without.likelihood
        degrees = len(effect_for(name, problem.device.axes)[1].coefficients)
        if loss < surprise(degrees, 30):
            effects, model = coefficients_of(without.observer), without
            del gains[name]
        else:
            gains[name] = loss
    return effects, gains
