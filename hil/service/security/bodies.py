"""How much a request may send: bounded before anything reads it."""

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from hil.service.problems import problem_response

MOST_BYTES = 1 << 20
RECORD_BYTES = 512 << 20
"""Of a record that is uploaded."""
_OTHERS = {"/api/uploads": RECORD_BYTES + (2 << 20)}  # a record, its map, and what a form needs around them
_REMEDY = "records are sent to /api/uploads; larger ones are imported beside the service with hil import"


class Bodies:
    """Refuses a body that is longer than any that is sound, by its announced length or as it comes."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        most = _OTHERS.get(scope["path"], MOST_BYTES)
        too_long = f"the body is longer than {most >> 20} MB, which no request to this path needs"
        announced = [value for name, value in scope["headers"] if name == b"content-length"]
        if any(not value.isdigit() or len(value) > 18 or int(value) > most for value in announced):
            await problem_response(413, too_long, _REMEDY)(scope, receive, send)
            return
        came = 0

        async def bounded() -> Message:
            nonlocal came
            message = await receive()
            came += len(message.get("body", b""))
            if came > most:
                raise HTTPException(413, too_long)
            return message

        await self._app(scope, bounded, send)
