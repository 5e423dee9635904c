"""What a board can do or says of which this host knows nothing: passed over, and told."""

from hil.numbers import counted
from hil.wire.messages import Capabilities, Identity

_UPDATE = "update the host to use it"


def unknown_parts(identity: Identity, passed_over: int) -> list[str]:
    """One line each: bits of IDENTITY.capabilities, and messages, that came after this host was made."""
    told = []
    known = sum(Capabilities)
    if unknown := identity.capabilities & ~known:
        told.append(f"the board can do more than this host knows (capabilities {unknown:#x}); {_UPDATE}")
    if passed_over:
        told.append(f"{counted(passed_over, 'optional message')} of the board passed over, unknown here; {_UPDATE}")
    return told
