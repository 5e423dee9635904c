"""What is seen with a model of two axes: one scan of what it leaves, for all candidates at once."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from estimator.effects.search import Search
from estimator.settings import Device, Gain, ObserverSettings
from estimator.thresholds import THRESHOLDS
from estimator.trace.candidates import Parameters, kind, of_resonance_alone, searched_by, watch_list
from estimator.trace.certainty import TWO_SIDED
from estimator.trace.criterion import threshold
from estimator.trace.evidence import Evidence, evidence, likeness
from estimator.trace.fitting import Fitted, coefficients_of, is_lost
from estimator.trace.problem import Effects, Problem
from estimator.trace.scan import Scan, scan

_SET = THRESHOLDS.scan


@dataclass(frozen=True)
class Look:
    """What was watched, how they act on the record, and what each would explain, the best first."""

    watched: Mapping[str, Parameters]
    seen: Scan
    evidence: dict[str, Evidence]

    @property
    def serious(self) -> list[Evidence]:
        """Those that chance does not account for, the best first."""
        return [item for item in self.evidence.values() if item.significance > threshold(len(self.evidence))]

    def alike(self, name: str) -> dict[str, float]:
        """How well each other candidate imitates this one on the record (`likeness`)."""
        return likeness(self.seen, name)


def look_at(problem: Problem, model: Fitted) -> Look:
    """Scan what the model leaves, with all that may explain it; its lines are seen in the innovations of its last pass,
    or of one with the memory of the bench where the motion got away from that.
    """
    scanned = problem.under(scanned_with(model, problem.device, problem.settings))
    left, deviation = model.estimates.innovation, model.estimates.innovation_deviation
    if scanned.settings.gain is not Gain.EKF:
        base = scan(scanned, {}, model.observer)
        left, deviation = base.innovation, base.deviation
    everything = watch_list(problem.record, problem.device, left, deviation, problem.asked)
    watched = fresh(everything, model.settings.effects, problem.span)
    seen = scan(scanned, watched, model.observer, halves=True)
    return Look(watched, seen, evidence(seen))


def bounds(problem: Problem, model: Fitted, watched: Mapping[str, Parameters]) -> dict[str, Evidence]:
    """How large the coefficients of what is watched may be beside `model`, the best first.

    The constants are as sure as the bench file declares them, not as the record made them without the effect: what a
    stiffness takes up, as a hardening does at one amplitude, is not excluded by it.  Where the drive is of the
    resonance alone, that of a mode holds for every frequency below half the sampling rate.  Empty where the observer
    loses the motion from such a start.
    """
    others = {name: given for name, given in watched.items() if name not in model.settings.effects}
    seen = scan(problem.under(scanned_with(model, problem.device, problem.settings)), others, halves=True)
    found = evidence(seen) if seen.sound else {}
    if not of_resonance_alone(problem.record, problem.device):
        return found
    modes = [name for name in found if searched_by(name) is Search.MODES]
    return found | {name: _of_any_frequency(found[name], others[name]["omega"], problem) for name in modes}


def _of_any_frequency(item: Evidence, omega: float, problem: Problem) -> Evidence:
    """How large a mode may be, by what one at `omega` may be: at the resonance ω0 it is seen by r/(ω² − ω0²)."""
    resonance, highest = problem.device.target, (np.pi / float(np.mean(problem.record.step))) ** 2
    farthest = max(abs(highest - resonance), resonance) / abs(omega**2 - resonance)
    reach = farthest * (np.abs(item.coefficients) + TWO_SIDED * item.deviation)
    return replace(item, coefficients=np.zeros_like(reach), deviation=reach / TWO_SIDED)


def scanned_with(model: Fitted, device: Device, settings: ObserverSettings) -> ObserverSettings:
    """The model as it is to be scanned: without forgetting where it is nearly right, with the memory of the bench where
    the motion would get away from it.
    """
    if not is_lost(model.estimates.innovation, device):
        return replace(model.settings, gain=Gain.EKF)
    return replace(settings, gain=Gain.FADING, effects=coefficients_of(model.observer))


def fresh(watched: Mapping[str, Parameters], effects: Effects, span: float) -> dict[str, Parameters]:
    """What is watched and not carried: a line or a mode may come again at another frequency, everything else is there
    once.  span: length of the record in s, which tells frequencies apart.
    """
    carried = {kind(name) for name in effects}
    frequencies = [given["omega"] for given in effects.values() if "omega" in given]

    def is_new(name: str, given: Parameters) -> bool:
        if "omega" not in given:
            return kind(name) not in carried
        return all(abs(given["omega"] - other) >= _SET.apart / span for other in frequencies)

    new = {name: given for name, given in watched.items() if is_new(name, given)}
    return {_relabelled(name, effects, watched): given for name, given in new.items()}


def _relabelled(name: str, effects: Effects, watched: Mapping[str, Parameters]) -> str:
    """The name, with a label that neither what is carried nor what is watched has yet where it is carried."""
    if name not in effects:
        return name
    return next(free for n in count(1) if (free := f"{kind(name)}:{n}") not in effects and free not in watched)
