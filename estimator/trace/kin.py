"""Effects that a scan cannot choose between: laws of damping, which near a resonance differ by one number only, of a
spring, and of even order.

Dry friction takes from each cycle in proportion to the amplitude, linear damping to its square, drag to its cube, the
cubic laws to its fourth power (Nayfeh & Mook 1979, ch. 3).  Where the linear damping is estimated beside them, what
falls with the amplitude is one of the last with the other sign, or friction; how much each promises to first order says
little, since friction is far from linear in how slow the mass is where it turns over.  Of a law of even order, in the
channel, the spring or the damping, a vibration shows a shift and its second harmonic.
"""

from estimator.effects.labels import declared


def are_kin(name: str, other: str) -> bool:
    """Whether both are declared to be of one kin, as the laws of damping are."""
    one, two = declared(name), declared(other)
    return one is not None and two is not None and one.kin is not None and one.kin is two.kin
