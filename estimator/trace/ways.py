"""Other ways to begin a choice that ends short of the noise.

Of two effects at once, each draws some of the other, and who explains most by itself need not be one of the two: a
delay of the path stands in for a low-pass beside a cross-coupling, and what it leaves points at neither.  Where the
model that was chosen leaves more than an explained record may, the choice is made again from who came near the first.
"""

from collections.abc import Callable, Iterator
from itertools import islice

import numpy as np

from estimator.thresholds import THRESHOLDS
from estimator.trace.candidates import kind
from estimator.trace.criterion import TIE
from estimator.trace.engine import Chosen, Rules, Step, choose, exchanged, ranked, unphysical
from estimator.trace.judgement import unexplained
from estimator.trace.look import Look
from estimator.trace.observer_model import Carrying, ObserverModel

_SET = THRESHOLDS.choice


def best_way(
    family: ObserverModel,
    chosen: Chosen[Carrying, Look],
    rules: Rules,
    progress: Callable[[int, int], None] = lambda done, most: None,
) -> Chosen[Carrying, Look]:
    """`chosen`, or a choice that begins with another of its first round and is likelier, prices included; the first
    that leaves nothing ends the search.
    """
    first, best = chosen.first, chosen
    if first is None or not _leaves(chosen.fit):
        return chosen
    for name in islice(_others(family, first, rules), _SET.ways):
        beside = {one: trial for one, trial in first.beside.items() if one != name} | {first.name: first.trial}
        step = Step(name, first.beside[name], first.before, beside)
        begun = step, exchanged(chosen.rounds[0], name)
        way = choose(family, first.before, rules, progress, reducible=family, begun=begun)
        if _standing(way) > _standing(best) + TIE:
            best = way
            if not _leaves(best.fit):
                break
    return best


def _leaves(carrying: Carrying) -> bool:
    """Whether a model leaves more than an explained record may: what is predicted of the innovations hides much where
    the noise is declared larger than it is.
    """
    problem = carrying.problem
    resonance_hz = float(np.sqrt(problem.device.target)) / (2.0 * np.pi)
    return bool(unexplained(carrying.fitted, problem.record, resonance_hz))


def _others(family: ObserverModel, first: Step[Carrying], rules: Rules) -> Iterator[str]:
    """Who came near the first, of each other kind the best; no line, which takes up whatever any law leaves."""
    enough = _SET.as_near * first.trial.score.gain
    kinds = {kind(first.name)}
    for name in ranked(first.beside):
        trial = first.beside[name]
        if kind(name) in kinds or rules.last(name) or not trial.score.gain > enough:
            continue
        if unphysical(family.coefficients(trial.fit)) or family.objection(first.before, name, trial) is not None:
            continue
        kinds.add(kind(name))
        yield name


def _standing(chosen: Chosen[Carrying, Look]) -> float:
    """Its likelihood less the prices of what it takes."""
    return chosen.fit.fitted.likelihood - sum(step.trial.score.price for step in chosen.steps)
