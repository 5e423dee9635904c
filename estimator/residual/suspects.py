"""Which effects a finding points at.  A pointer, not a proof: it orders what a report lists.

Sources: the `signs` of the effects' own declarations (`estimator.effects`).
"""

from functools import cache

from estimator.effects.catalogue import EFFECTS
from estimator.effects.search import Sign


@cache
def suspects(sign: str) -> tuple[str, ...]:
    """Effects that `sign` points at, by name: those of which it is the most telling first; none that is rare.

    Raises ValueError for what is no sign.
    """
    given = Sign(sign)
    pointed = [effect for effect in EFFECTS if given in effect.signs and not effect.rare]
    return tuple(effect.name for effect in sorted(pointed, key=lambda effect: effect.signs.index(given)))
