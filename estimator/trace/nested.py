"""Effects that turn into a simpler one where their parameter goes: then the simpler one is what is there."""

from collections.abc import Mapping
from typing import Any

from estimator.effects.labels import declared
from estimator.effects.search import Search
from estimator.trace.criterion import TIE
from estimator.trace.engine import Trial

_THRESHOLDS = (Search.LIMITS, Search.BANDS)


def simpler_than(name: str) -> str:
    """What the effect `name` is at an end of its range; "" where it stays one of its own."""
    effect = declared(name)
    return "" if effect is None else effect.simpler


def simpler_by_standing(best: str, trials: Mapping[str, Trial[Any]]) -> str | None:
    """`estimator.trace.engine.Rules.simpler` of a family whose innovations are counted as independent samples."""
    simpler = simpler_than(best)
    if simpler in trials and trials[best].score.standing - trials[simpler].score.standing < TIE:
        return simpler
    return None
