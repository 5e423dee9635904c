"""How much a request may send: bounded before anything reads it."""

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from hil.service.problems import problem_response

MOST_BYTES = 1 << 20
_ELSEWHERE = frozenset({"/api/uploads"})  # which has a bound of its own, and writes what comes to a file
_TOO_LONG = f"the body is longer than {MOST_BYTES >> 20} MB, which no request to this path needs"
_REMEDY = "records are sent to /api/uploads"


class Bodies:
    """Refuses a body that is longer than any that is sound, by its announced length or as it comes."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        if scope["type"] != "http" or scope["path"] in _ELSEWHERE:
            await self._app(scope, receive, send)
            return
        announced = [value for name, value in scope["headers"] if name == b"content-length"]
        if any(not value.isdigit() or len(value) > 18 or int(value) > MOST_BYTES for value in announced):
            await problem_response(413, _TOO_LONG, _REMEDY)(scope, receive, send)
            return
        came = 0

        async def bounded() -> Message:
            nonlocal came
            message = await receive()
            came += len(message.get("body", b""))
            if came > MOST_BYTES:
                raise HTTPException(413, _TOO_LONG)
            return message

        await self._app(scope, bounded, send)
