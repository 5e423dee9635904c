"""What the routes share: where the runs are, who may do what, and what is told to everybody who looks."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from fastapi import Request

from hil.running.options import FileOptions
from hil.service.security.audit import Audit
from hil.service.security.hosts import Hosts
from hil.service.security.tokens import Holder, Tickets, Tokens
from hil.wire.link_name import LinkName

Listener = Callable[[dict[str, Any]], None]


PRIVATE = ".service"
"""Folder beside the runs in which the service keeps what is its own."""


@dataclass
class Service:
    """One service; routes get it by `service_of(request)`, background work by its part's `lifespan`.

    Attributes:
        folder: where the run folders are.
        links: links that its operator listed.
        files: files of this machine that its operator has runs write, which no request names.
        tell: called in the event loop with what every live client is told, such as {"kind": "job", …}; must not wait.
        at_signal: what is called at once when the service is told to end, before open requests are waited for.
        parts: what a part of the service shares with others, by its name; set in its `lifespan`.
    """

    folder: Path
    hosts: Hosts
    tokens: Tokens
    audit: Audit
    links: tuple[LinkName, ...] = ()
    files: FileOptions = field(default_factory=lambda: FileOptions())
    tickets: Tickets = field(default_factory=Tickets)
    tell: Listener = lambda _: None
    parts: dict[str, Any] = field(default_factory=dict)
    at_signal: list[Callable[[], None]] = field(default_factory=list)

    @property
    def private(self) -> Path:
        """The service's own folder, which exists."""
        return self.folder / PRIVATE


def service_of(request: Request) -> Service:
    return cast(Service, request.app.state.service)


def holder_of(request: Request) -> Holder:
    """Who asks; every guarded request has a holder."""
    return cast(Holder, request.state.holder)
