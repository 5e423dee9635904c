"""Whom a short part of the record speaks for, of many candidates that would each cost passes over all of it.

All are carried over the beginning of that part.  Over the rest of it go those that have a good share of what the best
gains there, and those that are spared, each by the observer that has seen the beginning.
"""

from collections.abc import Callable, Collection, Mapping
from functools import partial

from estimator.side_by_side import side_by_side
from estimator.thresholds import THRESHOLDS
from estimator.trace.criterion import TIE
from estimator.trace.fitting import carried_on, deficit, fit
from estimator.trace.problem import Effects, Problem

_SET = THRESHOLDS.choice


def spoken_for(
    problem: Problem,
    effects: Effects,
    without: Effects,
    others: Mapping[str, Effects],
    spared: Collection[str],
    gain: float,
    progress: Callable[[str, int, int], None],
) -> list[str]:
    """Of the others, by name each with what is carried then: those spared that have a good share of what the best
    gains, and of the rest those that do as well as the best, the nearest first, and no more than are carried at a time.

    effects: what is carried with the best, and `without` it, which gains so much over the whole record of `problem`.
    What goes with a temperature shows late: where there is one, whoever is spared stays, and all see all of the part.
    """
    part = problem.part(slice(0, _SET.screened))
    samples = len(part.record)
    slow = "temperature" in problem.record.channels
    names = [name for name in others if not (slow and name in spared)]
    first = samples if slow else min(_SET.glanced, samples)
    asked = [effects, without, *(others[name] for name in names)]
    reached, base, *found = side_by_side(
        [partial(fit, part.part(slice(0, first)).carrying(one), passes=1) for one in asked],
        lambda done: progress("other kinds", done, len(asked)),
    )
    start = round(samples / first)  # as many samples are the start of the beginning as of the part

    def enough(seen: int, start: int) -> float:
        """A deficit over so many samples with which there is still a good share of the gain."""
        gained = max(deficit(reached, base, start), gain * seen / len(problem.record))
        return max(THRESHOLDS.width.as_good * gained, THRESHOLDS.parameters.rough_start)

    tried = dict(zip(names, found, strict=True))
    if first < samples:
        bar = enough(first, start)
        tried = {name: one for name, one in tried.items() if name in spared or deficit(reached, one, start) < bar}
        rest = part.record.part(slice(first, samples))
        reached, base, *found = side_by_side(
            [partial(carried_on, one, rest) for one in (reached, base, *tried.values())]
        )
        tried = dict(zip(tried, found, strict=True))
    behind = {name: deficit(reached, one) for name, one in tried.items()}
    bar = enough(samples, 1)
    near = sorted((name for name in behind if name not in spared and behind[name] < TIE), key=lambda name: behind[name])
    stay = [name for name in others if name in spared and (name not in names or behind.get(name, bar) < bar)]
    return stay + near[: THRESHOLDS.width.batch]
