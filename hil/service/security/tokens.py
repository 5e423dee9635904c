"""Tokens: who holds which role.  They are compared in constant time, by their hashes, and never shown again."""

import hashlib
import hmac
import secrets
from collections.abc import Iterable
from dataclasses import dataclass, field

from hil.service.security.roles import Role

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
        """A new token for `holder`."""
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
