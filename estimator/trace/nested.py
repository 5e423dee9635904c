"""Effects that turn into a simpler one where their parameter goes: then the simpler one is what is there."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from estimator.effects.search import Search
from estimator.trace.candidates import at_resonance, declared, searched_by
from estimator.trace.criterion import TIE
from estimator.trace.engine import Trial
from estimator.trace.look import Look
from estimator.trace.problem import Problem

_THRESHOLDS = (Search.LIMITS, Search.BANDS)


def simpler_than(name: str) -> str:
    """What the effect `name` is at an end of its range; "" where it stays one of its own."""
    effect = declared(name)
    return "" if effect is None else effect.simpler


def simpler_in(name: str, look: Look) -> str | None:
    """The same where it is watched, as `estimator.trace.engine.Rules.nested` of the bench's observer."""
    simpler = simpler_than(name)
    return simpler if simpler in look.watched else None


def simpler_by_standing(best: str, trials: Mapping[str, Trial[Any]]) -> str | None:
    """`estimator.trace.engine.Rules.simpler` of a family whose innovations are counted as independent samples."""
    simpler = simpler_than(best)
    if simpler in trials and trials[best].score.standing - trials[simpler].score.standing < TIE:
        return simpler
    return None


def with_simpler(names: Iterable[str], watched: Iterable[str]) -> list[str]:
    """These, and what any of them may turn into, where that is watched."""
    known = set(watched)
    wanted = list(names)
    for name in tuple(wanted):
        simpler = simpler_than(name)
        if simpler in known and simpler not in wanted:
            wanted.append(simpler)
    return wanted


def turned_into(problem: Problem, name: str, parameters: Mapping[str, float]) -> str | None:
    """What is left of the effect `name` with its threshold there, None where it is still one of its own.

    A drive that stops short of the least that was commanded is one of another gain, and so is one that does nothing
    below the largest; one that does nothing below the least does all that it should.  A mode at the resonance follows
    the drive as the gyro does, whose drive has another gain.
    """
    search = searched_by(name)
    if search is Search.MODES:
        omega, _ = parameters.values()
        own = at_resonance(problem.record, problem.device, np.array([omega]))
        return "the gyro itself, its drive of another gain" if own[0] else None
    simpler = simpler_than(name).replace("_", " ")
    if not simpler or search not in _THRESHOLDS:
        return None
    given = np.abs(problem.record.drive[:, :, 0]) * problem.device.drive_gain
    (threshold,) = parameters.values()
    least = float(np.min(given, where=given > 0.0, initial=np.inf))
    if search is Search.LIMITS:
        return simpler if threshold <= least else None
    if threshold <= least:
        return "no effect at all"
    return simpler if threshold >= float(np.max(given, initial=0.0)) else None
