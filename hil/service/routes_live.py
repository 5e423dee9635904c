"""The live connection: a WebSocket that says what the board does, and what was asked for of a run while it lasts."""

import asyncio
import json
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any, cast

from fastapi import APIRouter
from starlette.websockets import WebSocket, WebSocketDisconnect

from hil.service.board.part import BoardPart
from hil.service.security.tokens import Holder
from hil.service.service import Service
from hil.service.telemetry.client import Client
from hil.service.telemetry.hub import Hub
from hil.service.viewers import Viewers

router = APIRouter(tags=["live"])
_HELLO_S = 5.0
_LOG = logging.getLogger(__name__)
_RUNNING_S, _QUIET_S = 0.1, 0.25
_MOST_CLIENTS = 64
_NO_TOKEN, _FULL = 4401, 4429


class _Live:
    """All clients, and what they are told of the board."""

    def __init__(self, service: Service, board: BoardPart) -> None:
        self.service, self.board, self.hub = service, board, Hub()
        self.clients: set[Client] = set()
        self.viewers: Viewers | None = None
        self._changed = asyncio.Event()
        self._ended: dict[str, Any] | None = None  # what the last run said of itself, for pages that come after it
        board.on_track = self.hub.attach
        board.on_state.append(self._changed.set)
        board.on_run.append(lambda _: self.hub.end())
        service.tell = self._line

    def state(self) -> dict[str, Any]:
        """As GET /api/board, with the figures of the run as they are now."""
        told = self.board.state
        if self.hub.live and told["run"] is None and not told["stage"]:
            self.hub.end()
        now = self.now()
        if now is not None and told["run"] is not None:
            self._ended = {"run": told["run"], **now}
        return {"kind": "state", **told, "now": now, "ended": None if now is not None else self._ended}

    def now(self) -> dict[str, Any] | None:
        return self.hub.now.run(self.hub.tracks) if self.hub.live else None

    async def tell_state(self) -> None:
        """The state to everybody: often while a run lasts, now and then else, and when it changes."""
        while True:
            try:
                self._tell_state()
            except Exception:  # noqa: BLE001 - a page that hears no more would go on showing what was
                _LOG.exception("the state could not be sent; it is tried again")
            await asyncio.sleep(_RUNNING_S)
            self._changed.clear()
            if not self.hub.live:
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._changed.wait(), _QUIET_S - _RUNNING_S)

    def _tell_state(self) -> None:
        if self.hub.live:
            self.board.health = self.hub.now.health(self.hub.tracks)
        if self.clients or self.viewers is not None:
            state = self.state()
            if self.viewers is not None:
                self.viewers.state(state)
            for client in self.clients:
                client.newest("state", state)

    async def safe(self, holder: Holder) -> dict[str, Any]:
        said = await self.board.safe()
        self.service.audit.note_anyway(holder, "safe", **said)
        return said

    def _line(self, message: dict[str, Any]) -> None:
        for client in self.clients:
            client.line(message)


@asynccontextmanager
async def lifespan(service: Service) -> AsyncIterator[None]:
    """Looks at the run's rings for as long as the service lives."""
    live = _Live(service, cast(BoardPart, service.parts["board"]))
    service.parts["live"] = live
    if (viewers := service.parts.get("viewers")) is not None:
        live.viewers = viewers
        live.hub.looked.add(lambda: viewers.looked(live.hub.tracks))
    tasks = [asyncio.ensure_future(work) for work in (live.hub.follow(), live.tell_state())]
    live.board.on_run.append(lambda run: _take_over(service, run))
    live.board.line.attach()
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        live.hub.detach()


def _take_over(service: Service, run: str | None) -> None:
    """Have the catalogue look at a run that has ended, at once."""
    if run is not None and (catalogue := service.parts.get("catalogue")) is not None:
        asyncio.get_running_loop().run_in_executor(None, catalogue.look_at, run)


@router.websocket("/api/live")
async def live(socket: WebSocket) -> None:
    """See docs/reference/service.md."""
    parts = socket.app.state.service.parts["live"]
    service: Service = socket.app.state.service
    await socket.accept()
    holder = await _greeted(socket, service)
    if holder is None:
        await _close(socket, _NO_TOKEN, "the first message is {op: hello, token: …} with a valid token")
        return
    if len(parts.clients) >= _MOST_CLIENTS:
        await _close(socket, _FULL, f"{_MOST_CLIENTS} clients are connected already")
        return
    client = Client(socket, parts.hub, lambda: parts.safe(holder))
    client.newest("state", parts.state())
    parts.clients.add(client)
    try:
        await client.serve()
    finally:
        parts.clients.discard(client)
        await _close(socket)


async def _close(socket: WebSocket, code: int = 1000, reason: str | None = None) -> None:
    """Say why; a client that has gone by then does not hear it."""
    with suppress(RuntimeError, WebSocketDisconnect):
        await socket.close(code, reason)


async def _greeted(socket: WebSocket, service: Service) -> Holder | None:
    """Whose token the first message brings."""
    try:
        message = json.loads(await asyncio.wait_for(socket.receive_text(), _HELLO_S))
    except (TimeoutError, ValueError, RecursionError, KeyError, WebSocketDisconnect, RuntimeError):
        return None
    if not isinstance(message, dict) or message.get("op") != "hello" or not isinstance(message.get("token"), str):
        return None
    return service.tokens.holder_of(message["token"])
