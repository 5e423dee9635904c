"""Who has gone before it was answered leaves no error behind."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.websockets import WebSocketDisconnect

from hil.service import routes_live


class Gone:
    """A socket whose other end left, after its first message or before."""

    def __init__(self, first: str | None, clients: int) -> None:
        self.first = first
        self.told: list[int] = []
        tokens = SimpleNamespace(holder_of=lambda token: "holder")
        parts = {"live": SimpleNamespace(clients=set(range(clients)))}
        self.app = SimpleNamespace(state=SimpleNamespace(service=SimpleNamespace(parts=parts, tokens=tokens)))

    async def accept(self) -> None:
        """It was there then."""

    async def receive_text(self) -> str:
        if self.first is None:
            raise WebSocketDisconnect
        return self.first

    async def close(self, code: int, reason: str | None) -> None:
        self.told.append(code)
        raise WebSocketDisconnect


@pytest.mark.parametrize(("first", "code"), [(None, 4401), ('{"op": "hello", "token": "right"}', 4429)])
def test_whoever_is_gone_hears_no_refusal_and_breaks_nothing(first: str | None, code: int) -> None:
    socket: Any = Gone(first, 10_000)
    asyncio.run(routes_live.live(socket))
    assert socket.told == [code]
