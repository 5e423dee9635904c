"""Effects that a scan cannot choose between: laws of damping, which near a resonance differ by one number only.

Dry friction takes from each cycle in proportion to the amplitude, linear damping to its square, drag to its cube, the
cubic laws to its fourth power (Nayfeh & Mook 1979, ch. 3).  Where the linear damping is estimated beside them, what
falls with the amplitude is one of the last with the other sign, or friction; how much each promises to first order says
little, since friction is far from linear in how slow the mass is where it turns over.
"""

from collections.abc import Iterable, Mapping

from estimator.effects.catalogue import EFFECTS
from estimator.trace.candidates import kind

_KIN = {effect.name: effect.kin for effect in EFFECTS if effect.kin is not None}


def are_kin(name: str, other: str) -> bool:
    """Whether both are declared to be of one kin, as the laws of damping are."""
    one = _KIN.get(kind(name))
    return one is not None and one is _KIN.get(kind(other))


def kin_of(best: str, watched: Iterable[str], tried: Mapping[str, object]) -> list[str]:
    """All that are watched and akin to the best, whatever they promise, and were not tried."""
    return [name for name in watched if are_kin(best, name) and name not in tried]
