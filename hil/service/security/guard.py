"""What every request passes before a route sees it: the name it calls us by, where it comes from, its token."""

from collections.abc import Iterable

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from hil.service.problems import problem_response
from hil.service.security.hosts import Hosts
from hil.service.security.tokens import Holder, Tickets, Tokens, needed

_LOOKING = frozenset({"GET", "HEAD", "OPTIONS"})
_OURS = frozenset({b"same-origin", b"none"})


class Guard:
    """Refuses what does not call this service by a name of its own, comes from another site's page, or has no token
    for what it asks.  The holder is put where routes find it: `request.state.holder`.

    A WebSocket says its token in its first message; here its host and origin are looked at.
    """

    def __init__(self, app: ASGIApp, *, hosts: Hosts, tokens: Tokens, tickets: Tickets) -> None:
        self._app = app
        self._hosts = hosts
        self._tokens = tokens
        self._tickets = tickets

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        if scope["type"] == "websocket":
            if self._stranger(scope, changing=True):
                await receive()
                await send({"type": "websocket.close", "code": 1008})
                return
            await self._app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in ALWAYS.items():
                    headers.setdefault(name, value)
            await send(message)

        refused = self._refused(scope)
        await (self._app if refused is None else refused)(scope, receive, with_headers)

    def _refused(self, scope: Scope) -> ASGIApp | None:
        method, path = scope["method"], scope["path"]
        if said := self._stranger(scope, changing=method not in _LOOKING):
            return problem_response(403, said, "call it by its address, or name it: hil serve --name NAME")
        if "\0" in path:  # no file has such a name, and what looks for it fails
            return problem_response(404, "there is nothing here", "GET /openapi.json lists what there is")
        role = needed(method, path)
        if role is None:
            return None
        holder = self._tokens.of_header(_values(scope, b"authorization")) or self._of_ticket(scope)
        if holder is None:
            answer = problem_response(401, "no valid token", "send Authorization: Bearer TOKEN; hil serve prints it")
            answer.headers["www-authenticate"] = "Bearer"
            return answer
        if holder.role < role:
            return problem_response(
                403, f"this needs the role {role.name.lower()}, the token has {holder.role.name.lower()}"
            )
        scope.setdefault("state", {})["holder"] = holder
        return None

    def _of_ticket(self, scope: Scope) -> Holder | None:
        if scope["method"] not in _LOOKING:
            return None
        return self._tickets.holder_of(scope["path"], scope["query_string"])

    def _stranger(self, scope: Scope, *, changing: bool) -> str:
        """What is wrong with the host or the origin, "" if nothing is."""
        hosts = [value.decode("latin-1") for value in _values(scope, b"host")]
        if len(hosts) != 1 or not self._hosts.knows(hosts[0]):
            return "the Host header is none of this service's names"
        if not changing:
            return ""
        origins = [value.decode("latin-1") for value in _values(scope, b"origin")]
        if any(not self._hosts.is_own(origin, hosts[0]) for origin in origins):
            return "the request comes from another site's page (Origin)"
        if any(value not in _OURS for value in _values(scope, b"sec-fetch-site")):
            return "the request comes from another site's page (Sec-Fetch-Site)"
        return ""


def _values(scope: Scope, name: bytes) -> Iterable[bytes]:
    return [value for key, value in scope["headers"] if key == name]


_DIRECTIVES = {
    "default-src": "'none'",
    "script-src": "'self'",
    "style-src": "'self'",
    "img-src": "'self' data: blob:",
    "font-src": "'self'",
    "connect-src": "'self'",
    "frame-src": "'self'",
    "manifest-src": "'self'",
    "worker-src": "'self'",
    "base-uri": "'none'",
    "form-action": "'none'",
    "frame-ancestors": "'none'",
}
POLICY = "; ".join(f"{name} {sources}" for name, sources in _DIRECTIVES.items())
"""Content-Security-Policy of everything that does not bring its own."""

ALWAYS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-store",
}
