"""Which effects the model lacks: one after another, each the one that explains most, as exactly as the model goes.

A scan of the record tells how much every effect of the catalogue would explain and who looks like whom; the few that
come into question are then carried by an observer each, and their likelihoods decide.  Each effect taken is carried
from then on, and the residual that is left is scanned again.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from estimator.effects.catalogue import effect_for
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings
from estimator.trace.candidates import Parameters, watch_list
from estimator.trace.evidence import Evidence, evidence, likeness
from estimator.trace.fitting import Effects, Fitted, coefficients_of, fit
from estimator.trace.parameters import refine_parameters
from estimator.trace.record import Record
from estimator.trace.scan import Scan, Watched, scan

MOST = 4
CHANCE = 1e-4  # of naming anything on a record to which nothing is to be added
_LOCKED = 0.03  # of the amplitude: an innovation larger than that makes the linear scan unsure
_SAME = 0.97  # likeness above which a candidate is tried for itself beside the best
_SERIOUS = 0.5  # of the best gain: a candidate with that much is tried as well
_NEAR = 0.9  # of the best gain: parameters are improved before the choice
_TRIED = 5
_APART = 30.0  # rad over the record: closer than that two frequencies are one
_COMPARED = 200_000  # samples on which candidates are compared


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
class Selection:
    """Effects in the order in which they were taken, with their coefficients; the rounds; models before and after."""

    effects: Effects
    rounds: tuple[Step, ...]
    before: Fitted
    after: Fitted
    gain: Mapping[str, float]

    @property
    def samples(self) -> int:
        """How many samples the models were fitted to."""
        return len(self.after.estimates.innovation)


Progress = Callable[[str, int, int], None]


def select(
    record: Record,
    device: Device,
    settings: ObserverSettings,
    controller: ControllerSettings | None,
    progress: Progress,
) -> Selection:
    """Choose effects on `record`, the part to be fitted; `settings` carries those that are known already."""
    compared = record.part(slice(0, _COMPARED))
    span = float(np.sum(compared.step))
    known: dict[str, dict[str, float]] = {name: dict(given) for name, given in settings.effects.items()}
    effects: Effects = dict(known)
    rounds: list[Step] = []
    gains: dict[str, float] = {}
    model = fit(compared, device, settings, controller, effects)
    first = model
    while len(rounds) <= MOST:
        carried = scanned_with(model, device, settings)
        base = scan(compared, device, carried, controller, {}, model.observer)
        watched = watch_list(compared, device, base.innovation, base.deviation)
        seen = scan(compared, device, carried, controller, fresh(watched, effects, span), model.observer)
        found = evidence(seen)
        serious = [item for item in found.values() if item.significance > threshold(len(found))]
        progress("effects", len(rounds) + 1, MOST + 1)
        if not serious or len(rounds) == MOST:
            rounds.append(Step(watched, found, None, {}, {}))
            break
        tried = shortlist(seen, serious)
        models = {name: fit(compared, device, settings, controller, {**effects, name: watched[name]}) for name in tried}
        leading = max(fitted.likelihood for fitted in models.values()) - model.likelihood
        for name in worth_refining(models, model, leading, watched):
            models[name] = refine_parameters(compared, device, settings, controller, models[name], name)
        best = max(models, key=lambda name: models[name].likelihood)
        gain = models[best].likelihood - model.likelihood
        degrees = len(effect_for(best, device.axes)[1].coefficients)
        rounds.append(
            Step(
                watched, found, best if gain > surprise(degrees, len(found)) else None, likeness(seen, best),
                {name: fitted.likelihood - model.likelihood for name, fitted in models.items()},
            )
        )  # fmt: skip
        if rounds[-1].taken is None:
            break
        gains[best] = gain
        model = models[best]
        effects = coefficients_of(model.observer)
    effects, gains = prune(compared, device, controller, model, known, gains)
    whole = len(record) > len(compared)
    before = fit(record, device, settings, controller, known) if whole else first
    after = (
        fit(record, device, model.settings, controller, effects)
        if whole or len(effects) < len(model.observer.effects)
        else model
    )
    return Selection(effects, tuple(rounds), before, after, gains)


def threshold(candidates: int) -> float:
    """Significance (log10 of a probability) that chance reaches for none of so many candidates."""
    return float(-np.log10(CHANCE / max(candidates, 1)))


def surprise(degrees: int, candidates: int) -> float:
    """Gain of twice the log-likelihood that chance gives the best of so many candidates."""
    return float(chi2.isf(CHANCE / max(candidates, 1), degrees))


def fresh(watched: Mapping[str, Parameters], effects: Effects, span: float) -> Watched:
    """What is watched and not carried: a line or a mode may come again at another frequency, everything else is there
    once.  span: length of the record in s, which tells frequencies apart.
    """
    carried = {name.partition(":")[0] for name in effects}
    frequencies = [given["omega"] for given in effects.values() if "omega" in given]

    def is_new(name: str, given: Parameters) -> bool:
        if "omega" not in given:
            return name.partition(":")[0] not in carried
        return all(abs(given["omega"] - other) > _APART / span for other in frequencies)

    return {name: given for name, given in watched.items() if is_new(name, given)}


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


def worth_refining(
    models: Mapping[str, Fitted], base: Fitted, leading: float, watched: Mapping[str, Parameters]
) -> list[str]:
    """Of those that come near the best, the ones with parameters; of two with the same parameters the better."""
    near = [name for name, fitted in models.items() if fitted.likelihood - base.likelihood > _NEAR * leading]
    near.sort(key=lambda name: -models[name].likelihood)
    taken: list[str] = []
    for name in near:
        if watched[name] and all(watched[name] != watched[other] for other in taken):
            taken.append(name)
    return taken


def prune(
    record: Record,
    device: Device,
    controller: ControllerSettings | None,
    model: Fitted,
    known: Effects,
    gains: dict[str, float],
) -> tuple[Effects, dict[str, float]]:
    """Take out again what the later effects have made superfluous."""
    effects = coefficients_of(model.observer)
    for name in list(gains):
        if len(effects) - len(known) < 2:
            break
        rest = {other: given for other, given in effects.items() if other != name}
        without = fit(record, device, model.settings, controller, rest, passes=1)
        loss = model.likelihood - without.likelihood
        degrees = len(effect_for(name, device.axes)[1].coefficients)
        if loss < surprise(degrees, 30):
            effects, model = coefficients_of(without.observer), without
            del gains[name]
        else:
            gains[name] = loss
    return effects, gains
