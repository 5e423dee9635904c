"""Three roles, each with what the one before it may do; which of them a request needs."""

from enum import IntEnum


class Role(IntEnum):
    """What the holder of a token may do."""

    LOOK = 1
    """see everything that is recorded or measured, and send SAFE"""
    OPERATE = 2
    """change what is recorded, and operate the board that he has the lease of"""
    ADMINISTER = 3
    """read the audit log, have the catalogue made anew, and end another one's lease"""


_OPEN = ("/healthz", "/openapi.json")
_GUARDED = ("/api/", "/metrics")
_SAFE = ("/api/board/safe", "/safe")
_ADMINISTERED = ("/api/audit", "/api/catalogue/")
_LOOKING = frozenset({"GET", "HEAD"})


def needed(method: str, path: str) -> Role | None:
    """The role that a request needs, None for the page's own files and what says nothing of the bench.

    SAFE is for everybody who may look; every other request that changes something is for who may operate.
    """
    if path in _SAFE:
        return Role.LOOK
    if path in _OPEN or not path.startswith(_GUARDED):
        return None
    if path.startswith(_ADMINISTERED):
        return Role.ADMINISTER
    return Role.LOOK if method in _LOOKING else Role.OPERATE
