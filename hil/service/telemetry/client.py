"""One WebSocket client: what it asked for, sent as fast as it takes it, and never stored for it.

Texts of which only the newest counts (the state) take each other's place; frames are made when they are sent.  So what
a slow client holds up is one frame and a few lines, and what it loses is the oldest.
"""

import asyncio
import json
from collections import OrderedDict, deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from hil.errors import InputError
from hil.service.problems import refusal
from hil.service.telemetry.hub import Hub
from hil.service.telemetry.views import (
    AskPattern,
    AskSpectrum,
    PatternView,
    RollView,
    SpectrumView,
    Subscribe,
    TriggerView,
    View,
)

MOST_VIEWS = 32
_LINES = 64
_FRAME_EVERY_S = 1.0 / 60.0

_Asked = Subscribe | AskPattern | AskSpectrum
_ASKED: TypeAdapter[_Asked] = TypeAdapter(Annotated[_Asked, Field(discriminator="op")])
_VIEWS = {"subscribe", "pattern", "spectrum"}


class Client:
    """`safe` is what {"op": "safe"} does; its answer is sent as {"kind": "safe", …}."""

    def __init__(self, socket: WebSocket, hub: Hub, safe: Callable[[], Awaitable[dict[str, Any]]]) -> None:
        self._socket, self._hub, self._safe = socket, hub, safe
        self._newest: OrderedDict[str, dict[str, Any]] = OrderedDict()
        self._lines: deque[dict[str, Any]] = deque(maxlen=_LINES)
        self._asked: dict[int, _Asked] = {}
        self._views: dict[int, View] = {}
        self._not_here: set[int] = set()  # what the run does not have; the next one may
        self._run = hub.run
        self._news = asyncio.Event()
        self._line_waits = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()

    def newest(self, kind: str, message: dict[str, Any]) -> None:
        """A message that takes the place of the one of its kind before it."""
        self._newest[kind] = message
        self._news.set()

    def line(self, message: dict[str, Any]) -> None:
        """A message; the oldest that waits is lost where there are too many."""
        self._lines.append(message)
        self._line_waits.set()
        self._news.set()

    async def serve(self) -> None:
        """Until either side closes."""
        self._hub.looked.add(self._news.set)
        sender = asyncio.ensure_future(self._send())
        hearer = asyncio.ensure_future(self._hear())
        try:
            await asyncio.wait((sender, hearer), return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._hub.looked.discard(self._news.set)
            for task in (sender, hearer, *self._tasks):
                task.cancel()
            await asyncio.gather(sender, hearer, *self._tasks, return_exceptions=True)
            for view in self._views.values():
                view.close()

    async def _hear(self) -> None:
        while True:
            try:
                text = await self._socket.receive_text()
            except KeyError:
                self._refuse(None, "the message is binary; send JSON as text")
                continue
            except (WebSocketDisconnect, RuntimeError):
                return
            try:
                message = json.loads(text)
            except (ValueError, RecursionError):
                self._refuse(None, "the message is no JSON")
                continue
            self._do(message)

    def _do(self, message: Any) -> None:
        number = message.get("id") if isinstance(message, dict) else None
        op = message.get("op") if isinstance(message, dict) else None
        if not isinstance(op, str):
            self._refuse(number, 'the message is no object with an "op" that is a text')
            return
        if op == "safe":
            task = asyncio.ensure_future(self._bring_to_safe())
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        elif op == "unsubscribe" and isinstance(number, int):
            self._asked.pop(number, None)
            self._drop(number)
        elif op in _VIEWS:
            self._want(message)
        elif op != "hello":
            known = ", ".join(("hello", "safe", "unsubscribe", *sorted(_VIEWS)))
            self._refuse(number, f"op: {op[:40]!r} is none; there are {known}")

    def _want(self, message: Any) -> None:
        number = message.get("id")
        try:
            asked = _ASKED.validate_python(message)
        except ValidationError as error:
            first = error.errors()[0]
            self._refuse(number, f"{'.'.join(map(str, first['loc'][1:]))}: {first['msg']}")
            return
        if len(self._asked) >= MOST_VIEWS and asked.id not in self._asked:
            self._refuse(asked.id, f"{MOST_VIEWS} subscriptions are all that one client has")
            return
        self._drop(asked.id)
        self._asked[asked.id] = asked
        self._not_here.discard(asked.id)
        if self._hub.ready:
            self._make(asked)

    def _make(self, asked: _Asked) -> None:
        hub = self._hub
        try:
            if isinstance(asked, AskPattern):
                view: View = PatternView(asked, hub.tracks)
            elif isinstance(asked, AskSpectrum):
                view = SpectrumView(asked, hub.tracks)
            elif asked.mode == "trigger":
                view = TriggerView(asked, hub.tracks)
            else:
                view = RollView(asked, hub.tracks, hub.rolls)
        except InputError as error:
            self._not_here.add(asked.id)
            self._refuse(asked.id, str(error))
        else:
            self._views[asked.id] = view

    def _drop(self, number: int) -> None:
        if (view := self._views.pop(number, None)) is not None:
            view.close()

    def _refuse(self, number: Any, error: str) -> None:
        asked = number if isinstance(number, int) else None
        self.line({"kind": "error", "id": asked, **refusal(400, error)._asdict()})

    async def _bring_to_safe(self) -> None:
        self.line({"kind": "safe", **await self._safe()})

    async def _send(self) -> None:
        clock = asyncio.get_running_loop().time
        try:
            while True:
                await self._news.wait()
                self._news.clear()
                begin = clock()
                await self._say_lines()
                while self._newest:
                    await self._say(self._newest.popitem(last=False)[1])
                await self._frames()
                while (left := begin + _FRAME_EVERY_S - clock()) > 0.0:
                    with suppress(TimeoutError):
                        await asyncio.wait_for(self._line_waits.wait(), left)
                    await self._say_lines()  # an answer does not wait for the next frame
        except (WebSocketDisconnect, RuntimeError, OSError):
            return

    async def _say_lines(self) -> None:
        self._line_waits.clear()
        while self._lines:
            await self._say(self._lines.popleft())

    async def _frames(self) -> None:
        hub = self._hub
        if self._run != hub.run:  # another run: its channels may be others
            self._views.clear()
            self._not_here.clear()
            self._run = hub.run
        if not hub.ready:
            return
        for number, asked in list(self._asked.items()):
            if number not in self._views and number not in self._not_here:
                self._make(asked)
        for number, view in list(self._views.items()):
            if self._views.get(number) is view and (frame := view.frame(hub.tracks)) is not None:
                await self._socket.send_bytes(frame.packed(number))

    async def _say(self, message: dict[str, Any]) -> None:
        await self._socket.send_text(json.dumps(message, ensure_ascii=False, allow_nan=False))
