"""Tickets: a frame or a download cannot send a header, so it shows a short-lived right to read one path instead."""

import secrets
import time
from urllib.parse import parse_qs

from hil.service.security.roles import Role
from hil.service.security.tokens import Holder

_LASTS_S = 60.0
_AT_MOST = 1024


class Tickets:
    """Each is for one path, to be read only, for a minute; it gives the role look, whatever role asked for it."""

    def __init__(self) -> None:
        self._valid: dict[str, tuple[str, str, float]] = {}

    def make(self, path: str, holder: Holder) -> str:
        """A ticket for `path`."""
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
