"""Tokens: who holds which role.  They are compared in constant time, by their hashes, and never shown again."""

import hashlib
import hmac
import secrets
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import IntEnum
from urllib.parse import parse_qs


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


_BYTES = 24


@dataclass(frozen=True)
class Holder:
    """Who asks: the name that the audit log and a lease show, and the role."""

    name: str
    role: Role


@dataclass
class Tokens:
    """The tokens that are valid until the service ends."""

    _holders: dict[bytes, Holder] = field(default_factory=dict)

    def make(self, holder: Holder) -> str:
        token = secrets.token_urlsafe(_BYTES)
        self.accept(token, holder)
        return token

    def accept(self, token: str, holder: Holder) -> None:
        """Take a token that exists already."""
        self._holders[_digest(token)] = holder

    def holder_of(self, token: str) -> Holder | None:
        """Whose token it is, None if it is nobody's."""
        asked, found = _digest(token), None
        for digest, holder in self._holders.items():  # all of them, so that the time says nothing
            if hmac.compare_digest(digest, asked):
                found = holder
        return found

    def of_header(self, values: Iterable[bytes]) -> Holder | None:
        """The holder named by an `Authorization: Bearer TOKEN` header, of which there must be one."""
        given = list(values)
        if len(given) != 1:
            return None
        kind, _, token = given[0].decode("latin-1").partition(" ")
        return self.holder_of(token.strip()) if kind.lower() == "bearer" else None


def _digest(token: str) -> bytes:
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).digest()


_LASTS_S = 60.0
_AT_MOST = 1024


class Tickets:
    """Each is for one path, to be read only, for a minute; it gives the role look, whatever role asked for it."""

    def __init__(self) -> None:
        self._valid: dict[str, tuple[str, str, float]] = {}

    def make(self, path: str, holder: Holder) -> str:
        now = time.monotonic()
        self._valid = {ticket: value for ticket, value in self._valid.items() if value[2] > now}
        while len(self._valid) >= _AT_MOST:
            del self._valid[next(iter(self._valid))]
        ticket = secrets.token_urlsafe(18)
        self._valid[ticket] = path, holder.name, now + _LASTS_S
        return ticket

    def holder_of(self, path: str, query: bytes) -> Holder | None:
        """Who may read `path` by the ticket in `query`."""
        given = parse_qs(query.decode("latin-1")).get("ticket", [])
        entry = self._valid.get(given[0]) if len(given) == 1 else None
        if entry is None or entry[0] != path or entry[2] <= time.monotonic():
            return None
        return Holder(entry[1], Role.LOOK)
